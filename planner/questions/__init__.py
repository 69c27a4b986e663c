"""Plain questions: sentences that are read as questions, and their answers by shipped queries."""
