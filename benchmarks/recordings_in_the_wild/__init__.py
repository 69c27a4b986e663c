"""Bags as robots record them: each kind is mapped rightly, or refused with an option that works."""
