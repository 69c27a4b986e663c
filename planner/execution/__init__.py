"""Plan execution: a robot driven from viewpoint to viewpoint, re-planned, and logged in the map."""
