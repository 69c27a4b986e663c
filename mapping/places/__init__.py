"""Places: layout, registry, category belief."""
