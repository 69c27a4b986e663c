"""Encoders: images and texts as vectors of one space, by ONNX networks of the user's own."""
