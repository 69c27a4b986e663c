"""Plain questions: rules that turn English questions into shipped queries and their answers."""
