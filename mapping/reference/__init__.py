"""The reference mapper's rules: each equation of the thesis' sections 3.3.1, 3.3.2 and 4.3."""
