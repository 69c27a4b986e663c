"""Simulated houses: floor plans, furniture, furnishing, carried things, the grid of the floor."""
