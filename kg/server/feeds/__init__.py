"""Feeds: committed transactions and changed query answers, as they happen."""
