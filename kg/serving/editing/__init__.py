"""Editing of ontologies of maps: sources to compare, reloading, one file for an editor."""
