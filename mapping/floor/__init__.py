"""The floor from depth frames: which cells are free, which are not, and which nobody has seen."""
