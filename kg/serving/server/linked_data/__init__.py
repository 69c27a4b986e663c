"""Linked data: every IRI of the map as a page and as a document, past versions included."""
