"""Simulated recordings of random houses, with their truth."""
