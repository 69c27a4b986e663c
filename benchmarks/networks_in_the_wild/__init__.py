"""Networks in the wild: detectors as other programs export them."""
