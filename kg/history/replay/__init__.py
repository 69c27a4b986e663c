"""Replay: past states of one thing, of many, or of the whole map."""
