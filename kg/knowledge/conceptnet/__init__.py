"""ConceptNet importer: relations between the categories of an ontology, from ConceptNet edges.

Sources (`dump`, `graph4`, `tables5`, `api`) give `Edge`s; `names` and `senses` match their terms
to categories, `relate` aggregates them into relations, `edits` and `turtle` merge those into a
file that people may edit too. `importing` runs all steps.
"""
