"""Records of objects, places, searches and floor as quads and back, and the writer of frames."""
