"""From questions to goals, plans and searches by a robot, real or simulated."""
