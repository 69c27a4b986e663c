"""Frames: checked, read ahead, projected, and their sightings of things with positions."""
