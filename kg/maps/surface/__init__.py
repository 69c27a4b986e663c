"""Surface of a map: coloured voxels of what depth images showed, beside the graph."""
