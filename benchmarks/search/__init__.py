"""Searches on trial: real homes, hidden objects, four ways of searching, side by side."""
