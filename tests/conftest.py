"""Fixtures every room's tests share."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# the same examples in every run, on a machine however slow: what one run finds, anybody finds again
_PATIENT = [HealthCheck.too_slow]
settings.register_profile("same", derandomize=True, deadline=None, suppress_health_check=_PATIENT)
# new examples in every run, to look for faults with: HEREABOUTS_EXPLORE=1
settings.register_profile("explore", deadline=None, suppress_health_check=_PATIENT)
settings.load_profile("explore" if os.environ.get("HEREABOUTS_EXPLORE") else "same")

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("HEREABOUTS_SHARED", ROOT.parent / "shared"))


def shared_path(relative: str) -> Path:
    """A file or folder of the shared data; skips the test only where all of it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"shared data absent: set HEREABOUTS_SHARED (looked at {SHARED})")
    path = SHARED / relative
    assert path.exists(), f"{path} is missing although the shared data is there"
    return path


@pytest.fixture
def shared() -> object:
    """Callable: relative path -> path of shared data."""
    return shared_path


@contextmanager
def running_server(folder: Path, *options: str) -> Iterator[str]:
    """A real Oxigraph server over `folder`; gives its address."""
    binary = Path(sys.executable).with_name("oxigraph")
    for _ in range(5):  # somebody else may take the port between finding and binding it
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        command = [str(binary), "serve", "-l", str(folder), "-b", f"127.0.0.1:{port}", *options]
        with subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as server:
            try:
                if _answers(port, server):
                    yield f"http://127.0.0.1:{port}"
                    return
            finally:
                server.kill()
    raise AssertionError("the oxigraph server did not start")


def _answers(port: int, server: subprocess.Popen[bytes]) -> bool:
    """Whether the server accepts connections; False where it ended instead."""
    for _ in range(1200):
        with socket.socket() as attempt:
            if attempt.connect_ex(("127.0.0.1", port)) == 0:
                return server.poll() is None
        if server.poll() is not None:
            return False
        time.sleep(0.05)
    raise AssertionError("the oxigraph server did not answer within a minute")


@pytest.fixture
def sparql_server(tmp_path: Path) -> Iterator[str]:
    """Address of a fresh SPARQL server of another vendor's making, empty.

    `HEREABOUTS_TEST_SERVER` names another one to take, which runs already and may be written; the
    graphs of a map that it holds are dropped.
    """
    if address := os.environ.get("HEREABOUTS_TEST_SERVER"):
        _empty(address)
        yield address
        return
    with running_server(tmp_path / "served") as address:
        yield address


def _empty(address: str) -> None:
    from kg.endpoint import Endpoint
    from kg.remote import GRAPHS

    endpoint = Endpoint.at(address)
    for graph in GRAPHS:
        endpoint.update(f"DROP SILENT GRAPH <{graph}>")
    endpoint.close()


@pytest.fixture
def start_server(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Callable: (name, option...) -> address of another such server, up until the test ends."""
    with ExitStack() as running:

        def start(name: str, *options: str) -> str:
            return running.enter_context(running_server(tmp_path / name, *options))

        yield start


@pytest.fixture(autouse=True)
def _only_loopback(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Tests reach no network but this machine's own loopback."""
    connect = socket.socket.connect

    def guarded(self: socket.socket, address: object) -> None:
        host = address[0] if isinstance(address, tuple) else address
        if isinstance(address, tuple) and host not in ("127.0.0.1", "::1", "localhost"):
            raise OSError(f"tests must not reach {host}")
        return connect(self, address)  # type: ignore[arg-type]

    monkeypatch.setattr(socket.socket, "connect", guarded)
    yield
