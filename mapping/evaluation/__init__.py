"""Evaluation: a map's objects against hand-made truth."""
