"""Processes killed at random moments, and what the map must then still say."""
