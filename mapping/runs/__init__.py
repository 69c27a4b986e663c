"""Runs of a mapper: the lease of the map, resumption, and reports of progress."""
