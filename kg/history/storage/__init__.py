"""The log on disk: SQLite schema, compressed change sets, compaction, recovery."""
