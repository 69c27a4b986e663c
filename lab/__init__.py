"""Lab: evaluation against ground truth and simulated houses, a distribution beside the library."""
