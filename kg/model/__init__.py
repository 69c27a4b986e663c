"""Data model of a map: records, vocabulary, IRIs, transactions and errors."""
