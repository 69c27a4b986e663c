"""Categories and relations: load, compile, validate, compare, replace, reason."""
