"""Background knowledge: ontologies, ConceptNet, and objects' usual places."""
