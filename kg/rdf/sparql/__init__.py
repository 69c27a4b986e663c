"""The text of SPARQL queries and updates: lexer, parameters, vetting, operations."""
