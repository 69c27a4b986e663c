"""Inference: ONNX sessions, detectors, scene classifiers, the model zoo."""
