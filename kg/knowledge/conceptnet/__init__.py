"""ConceptNet importer: relations between the categories of an ontology, from ConceptNet edges.

The sources (`dump`, `api`) yield `Edge`s. `names` and `senses` match their terms to categories,
`relate` aggregates them into relations, `turtle` merges the relations into a file that people may
edit too. `importing` runs all steps.
"""
