"""`python -m hereabouts`: the command, where its script is not on the PATH."""

import sys

from hereabouts.cli import main

sys.exit(main())
