"""A simulated robot in the demo's house, behind a ROS 1 master."""
