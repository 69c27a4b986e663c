"""Sources of RGB-D frames with poses: recordings, bags and live streams."""
