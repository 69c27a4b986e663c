"""Viewpoint planning: sensor, candidate views, coverage, and the next best view."""
