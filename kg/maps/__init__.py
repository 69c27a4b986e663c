"""SemanticMap: create or open a map, read it, write it, query it, subscribe to it."""
