"""Camera poses estimated from RGB-D images: features, tracking, pose graph."""
