"""Recordings of RGB-D frames with poses, one module a format."""
