"""The placement model on trial: fitted, cross-validated and compared on real buildings."""
