"""Evaluation of networks on labelled photographs: detectors (COCO) and scene classifiers."""
