"""A search carried out: a robot driven from look to look, re-planned, and written down."""
