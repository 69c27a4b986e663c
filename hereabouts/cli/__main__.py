"""`python -m hereabouts.cli` is `hereabouts`."""

from hereabouts.cli import main

raise SystemExit(main())
