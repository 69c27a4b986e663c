"""Looks of a map's things: described, compared with words, and recognised by the names given."""
