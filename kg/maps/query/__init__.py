"""Query files: parameters, evaluation, result tables, subscriptions."""
