"""Servers of maps for tests that ask one thing at a time."""

from typing import Final

from kg.serving.server import Limits, Settings

#: a free port, and one process that evaluates queries
SMALL: Final = Settings(port=0, limits=Limits(workers=1))
