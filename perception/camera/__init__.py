"""Cameras: intrinsics, poses, depth registration, gravity alignment."""
