"""From questions to goals, plans and searches; and, on top of all rooms, the command line."""
