"""The log on disk: SQLite schema, row codec, term dictionary, compaction, recovery."""
