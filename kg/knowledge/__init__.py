"""Background knowledge: ontologies, words, ConceptNet, and objects' usual places."""
