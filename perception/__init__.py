"""From recordings to detections: the only room that imports onnxruntime and OpenCV.

It reads RGB-D frames, runs networks on them, and knows nothing of the graph.
"""
