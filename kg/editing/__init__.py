"""Ontologies of maps as people edit them: sources to compare, reloading, one file for an editor."""
