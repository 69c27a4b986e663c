"""Search goals: resolved targets, candidate queries over the graph, persistence of memories."""
