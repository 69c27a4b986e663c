"""ConceptNet into an ontology: where things are found, for the categories that are ours.

Sources (`dump`, `graph4`, `tables5`, `api`) give `Assertion`s; `names` and `senses` tell which of
them speak of our categories, `relate` weighs them into relations, `edits` and `turtle` bring those
into a file that people may edit too. `importing` does all of it.
"""
