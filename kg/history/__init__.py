"""History of the map: every transaction in a compact log, past states, reports.

`storage` keeps the transactions in SQLite (compressed change sets, key frames, recovery at the
opening of a map), `replay` derives past states, `reports` lists events and explains facts.
"""
