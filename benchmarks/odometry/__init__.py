"""Benchmark of poses estimated from images."""
