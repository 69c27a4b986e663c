"""Words: what everyday names of things mean in an ontology, and where such things are found."""
