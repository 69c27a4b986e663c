"""Plain questions with their meaning, in three parts, and their score."""
