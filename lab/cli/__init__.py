"""Commands of the lab, added to the command line: `evaluate` and `simulate`."""
