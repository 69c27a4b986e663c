"""Free space: where one can stand, how far it is by foot, and what can be seen from where."""
