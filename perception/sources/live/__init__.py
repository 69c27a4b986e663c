"""Live streams: frames of a ROS 1 master, a Foxglove WebSocket or a growing folder."""
