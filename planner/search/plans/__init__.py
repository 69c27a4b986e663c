"""Search plans: built from the belief, improved, explained, and rated beside baselines."""
