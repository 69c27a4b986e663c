"""Attacks on a served map, repeated on this machine alone; `python -m benchmarks.attack`."""
