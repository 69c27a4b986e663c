"""A furnished house, the camera and robot that look at it, and senses that are simulated.

Only what comes before the map is simulated here: pictures, depth, detections and scene scores.
"""
