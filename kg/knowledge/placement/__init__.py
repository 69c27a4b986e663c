"""Probability that a place of a category holds an object of a category, and its uncertainty.

docs/explanation/placement.md has the model.
"""
