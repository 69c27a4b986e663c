"""Plain questions, read by sentences or by clues, and their answers by shipped queries."""
