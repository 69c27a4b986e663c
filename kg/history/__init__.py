"""What the map believed before: every transaction, kept small, and how to read it back.

`coding` makes transactions small, `terms` interns what recurs, `log` keeps them in SQLite,
`recovery` brings log and store together when a map is opened, `past` folds them into the map as it
was, `telling` puts them into words, and `why` explains a fact.
"""
