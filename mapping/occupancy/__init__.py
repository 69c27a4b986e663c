"""Occupancy: depth to floor tiles, by storey."""
