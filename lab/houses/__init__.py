"""Random furnished houses, and the changes in them between two sessions."""
