"""From detections to changes of the map: localisation, association, confidence, place beliefs."""
