"""Evaluation of maps: a map's objects against complete hand-made or simulated truth."""
