"""Where to look first: goals of the graph as belief on the floor, and a plan of looks."""
