"""Ontologies that people edit: read with their imports, checked, told in words, taken in."""
