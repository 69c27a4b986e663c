"""Transactional quad storage: folder, memory, or a SPARQL 1.1 server."""
