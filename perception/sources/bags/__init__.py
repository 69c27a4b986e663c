"""Recordings in ROS bags and MCAP files."""
