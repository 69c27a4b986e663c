"""RDF: literals, syntaxes, stores, SHACL, and triples in standard vocabularies."""
