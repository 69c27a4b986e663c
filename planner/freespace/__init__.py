"""Free space: occupancy, rooms, geodesic distances, frontiers and lines of sight."""
