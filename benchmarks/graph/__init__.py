"""Speed of the graph, measured here and now, and beside other stores on the same facts."""
