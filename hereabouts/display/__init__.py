"""Display of maps and searches: plots, and scenes for viewers."""
