"""Surface: depth and colour of frames to coloured voxels, beside the map."""
