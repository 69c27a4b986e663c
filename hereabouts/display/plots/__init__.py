"""Visualization: maps, plans and searches as floor plans."""
