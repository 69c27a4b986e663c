"""Alignment: whether a recording's floor and objects fit a map, and where they would."""
