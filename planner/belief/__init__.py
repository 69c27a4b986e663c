"""Belief where a target is: priors on cells of the floor, and their Bayes updates."""
