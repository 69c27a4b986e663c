"""How likely a kind of place holds a kind of object, and how sure that is (docs/placement.md)."""
