"""History of the map: every transaction in a compact log, past states, reports.

`storage` keeps the transactions in SQLite (compressed change sets, key frames, recovery when
a map is opened), `replay` derives past states from them, `reports` lists events and explains facts.
"""
