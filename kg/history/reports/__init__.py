"""Reports: events of a thing, explanations of facts, as text and as PROV."""
