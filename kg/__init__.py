"""The knowledge graph: the only room that speaks RDF.

Everything the map knows lives in one RDF dataset. `kg.maps.semantic_map.SemanticMap` is its front
door;
the other rooms see the frozen records of `kg.model.records`, never a triple.
"""
