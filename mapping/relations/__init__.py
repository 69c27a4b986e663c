"""Spatial relations of objects: what is on, inside and beside what."""
