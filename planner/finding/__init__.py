"""Where to look first: goals of the graph as belief on the floor, a plan of looks; docs/search.md."""
