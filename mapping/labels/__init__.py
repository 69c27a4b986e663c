"""Labels of detectors, resolved to categories of the ontology."""
