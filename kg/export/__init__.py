"""Maps as files for other tools: RDF serialisations, and the thesis author's JSON."""
