"""Transports of the robot protocol: HTTP, pipes and ROS 1."""
