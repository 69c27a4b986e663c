"""`python -m planner.cli` is `hereabouts`."""

from planner.cli import main

raise SystemExit(main())
