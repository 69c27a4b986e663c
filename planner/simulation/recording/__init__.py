"""Simulated recordings: sessions of a random house that changes between them, and their truth."""
