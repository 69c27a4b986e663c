"""A map as a picture one wants to look at."""
