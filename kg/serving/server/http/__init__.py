"""HTTP itself: limits, authentication, conditional requests, errors, connections."""
