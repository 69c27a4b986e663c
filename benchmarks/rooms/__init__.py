"""The gate for object mappers: real rooms and simulated houses, beside the reference."""
