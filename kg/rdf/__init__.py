"""RDF terms, syntaxes and SHACL; independent of what a map holds."""
