"""The placement model on trial: fitted, cross-validated, and compared, on rooms of real buildings."""
