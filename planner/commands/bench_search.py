"""`hereabouts bench search`: things searched for in real homes, by four ways of searching."""
