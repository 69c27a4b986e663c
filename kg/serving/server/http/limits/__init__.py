"""Limits of connections: time, number, memory and rate, shared among clients."""
