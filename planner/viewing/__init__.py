"""Where to look: a sensor, looks from viewpoints, belief on cells, and tours that find soon."""
