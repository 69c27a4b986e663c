"""`python -m planner.commands` is `hereabouts`."""

from planner.commands import main

raise SystemExit(main())
