"""Benchmarks: `python -m benchmarks.NAME`. numpy has one thread in them, as in the commands."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
