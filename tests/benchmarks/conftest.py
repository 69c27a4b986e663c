"""Fixtures that run a benchmark's command line in this process."""

from __future__ import annotations

import importlib
from collections.abc import Callable

import pytest


def command(benchmark: str) -> Callable[[list[str]], int]:
    """The `main` of `python -m benchmarks.NAME`."""
    main: Callable[[list[str]], int] = importlib.import_module(
        f"benchmarks.{benchmark}.__main__"
    ).main
    return main


@pytest.fixture
def fails(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Callable: run a benchmark that must fail with exit code 1 and one line; returns the line."""

    def run(benchmark: str, *words: object) -> str:
        capsys.readouterr()
        assert command(benchmark)([str(word) for word in words]) == 1
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        return err

    return run


@pytest.fixture
def prints(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Callable: run a benchmark that must succeed; returns its standard output."""

    def run(benchmark: str, *words: object) -> str:
        capsys.readouterr()
        assert command(benchmark)([str(word) for word in words]) == 0
        return capsys.readouterr().out

    return run
