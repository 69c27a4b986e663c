"""Simulated senses: an RGB-D camera by ray casting, its depth noise, detector, scene classifier."""
