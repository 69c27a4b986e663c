"""Plots of evaluations: map and truth from above, reliability diagrams."""
