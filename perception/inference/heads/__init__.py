"""Heads: what the outputs of detection networks mean, recognised by the graph's own signature."""
