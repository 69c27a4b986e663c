"""Identity of things where the mapper is restarted: `python -m benchmarks.restarts --every N HOUSE ...`.

Each HOUSE holds what `hereabouts simulate house --sessions 2` wrote. Its sessions are mapped one
after the other into one map in memory, by a new mapper for each session and after every N frames of
the second (0: no restart there). Prints a Markdown row: things and objects as `hereabouts evaluate
map --sessions` counts them, milliseconds of mapping a frame, and triples written a frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from benchmarks.command_line import run
from kg.opening import in_memory_map
from mapping.evaluation.complete_truth import read_complete_truth
from mapping.evaluation.session_identity import pooled_identity, session_identity
from mapping.mapper import Mapper
