"""Endpoints of the SPARQL protocols, of history, assertions and records."""
