"""Object search: goals, beliefs, viewpoints and plans."""
