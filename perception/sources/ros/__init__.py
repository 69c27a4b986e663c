"""ROS messages as arrays, cameras and transforms; no ROS needed.

A message is any object with the fields of its definition, of ROS 1 or ROS 2: as `rosbags` reads it
from a file, or as a live connection delivers it.
"""
