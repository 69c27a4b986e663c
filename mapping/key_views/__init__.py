"""Key views of a map: what its cameras saw from some poses, by which others are recognised."""
