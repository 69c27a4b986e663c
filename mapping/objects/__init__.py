"""Objects: localisation, data association, confidence, visibility."""
