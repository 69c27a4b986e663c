"""Several maps behind one address: asked together, answered as one, each row with its member."""
