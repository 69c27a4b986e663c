"""Viewers: a map as Foxglove, Rerun and RViz draw it, and as it changes while it is made."""
