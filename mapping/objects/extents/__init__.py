"""Extents of objects, grown from the surface and fitted to the boxes of their detections."""
