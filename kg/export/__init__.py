"""Maps as files for other tools: RDF serialisations, GeoJSON and JSON."""
