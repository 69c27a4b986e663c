"""SPARQL Update from users: execution, completion, validation before commit."""
