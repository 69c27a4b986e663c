"""Copies of maps: mirrored live into a SPARQL server, or merged into one store in memory."""
