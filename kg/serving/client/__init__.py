"""Client of a served map: HTTP client, JSON encoding of records, change stream, remote map."""
