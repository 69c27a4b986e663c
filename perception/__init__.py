"""Perception: RGB-D recordings, object detectors, scene classifiers.

The only package that imports onnxruntime and OpenCV; it knows nothing of the graph.
"""
