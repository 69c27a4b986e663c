"""Mapping: detections and depth to objects, places and occupancy of a map."""
