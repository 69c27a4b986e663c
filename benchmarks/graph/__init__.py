"""How fast the graph is, measured here and now, and beside other stores on the same facts."""
