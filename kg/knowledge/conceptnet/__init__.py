"""ConceptNet importer: relations between the categories of an ontology, from ConceptNet edges.

The sources (`dump`, `graph4`, `tables5`, `api`) yield `Edge`s. `names` and `senses` match their
terms to categories, `relate` aggregates them into relations, `edits` and `turtle` merge the
relations into a file that people may edit too. `importing` runs all steps.
"""
