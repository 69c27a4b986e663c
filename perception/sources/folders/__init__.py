"""Formats of recordings that are folders of images."""
