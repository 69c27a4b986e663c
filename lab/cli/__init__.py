"""Commands of the lab, added to the command line: `evaluate`, `simulate` and `thesis`."""
