"""Work inside a worker: queries, updates, documents, the history, ontologies."""
