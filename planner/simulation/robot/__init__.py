"""The simulated robot: how it moves, its odometry, the tour it maps by, the robot protocol."""
