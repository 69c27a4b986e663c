"""Object identity over time: moves, departures and merges."""
