"""Search ordering problems: files of them, generated worlds, and other planners beside ours."""
