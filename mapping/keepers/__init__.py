"""Keepers: pictures, views and surface that are written beside the map while a scene is mapped."""
