"""Detections of a run: the fate of each, and the report of the things that are not believed."""
