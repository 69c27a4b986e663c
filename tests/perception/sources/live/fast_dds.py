"""A peer of Fast DDS, the DDS of Humble and Jazzy, as a process: publisher and subscriber."""

import shutil
import subprocess
import threading
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from perception.sources.ros.message_types import message_types, serialised

SOURCE = Path(__file__).with_name("fastdds") / "peer.cpp"
REASON = "no Fast DDS here: apt-get install libfastrtps-dev g++"


def is_there() -> bool:
    headers = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
    return shutil.which("g++") is not None and headers.exists()


@cache
def program() -> str:
    """The peer's program, compiled where it is not yet, or is older than its source."""
    made = Path(gettempdir()) / f"hereabouts-fastdds-{SOURCE.stat().st_mtime_ns}"
    if not made.exists():
        new = f"{made}-{threading.get_native_id()}"
        words = ["g++", "-std=c++14", str(SOURCE), "-o", new, "-lfastrtps", "-lfastcdr"]
        subprocess.run(words, check=True, capture_output=True)
        Path(new).rename(made)
    return str(made)


class FastDdsPeer:
    """A publisher of `types` (topic -> type) as `Ros2Publisher` is one; it subscribes, too."""

    def __init__(self, domain, types, latched=frozenset(), best=frozenset()):
        words = [program(), str(domain.number)]
        self._process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._types, self._matched = dict(types), Counter[str]()
        self._heard: dict[str, tuple[str, Callable[[Any], object]]] = {}
        self._lock = threading.Lock()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        for topic, kind in types.items():
            self._declare("pub", topic, kind, best=topic in best, latched=topic in latched)

    def subscribe(self, topic, kind, heard, *, latched=False):
        """Call `heard` with each message of a topic, in a thread of its own."""
        self._heard[topic] = kind, heard
        self._declare("sub", topic, kind, best=False, latched=latched)

    def _declare(self, what: str, topic: str, kind: str, *, best: bool, latched: bool) -> None:
        package, part, name = kind.split("/")
        quality = f"{'best' if best else 'reliable'} {'latched' if latched else 'volatile'}"
        self._send(f"{what} {topic} {package}::{part}::dds_::{name}_ {quality}\n".encode())

    def _send(self, data: bytes) -> None:
        with self._lock:
            assert self._process.stdin is not None
            if self._process.poll() is not None:
                return  # it has ended
            self._process.stdin.write(data)
            self._process.stdin.flush()

    def _listen(self) -> None:
        out = self._process.stdout
        assert out is not None
        while line := out.readline().decode():
            what, topic, *size = line.split()
            if what == "matched":
                self._matched[topic] += 1
                continue
            data, (kind, heard) = out.read(int(size[0])), self._heard[topic]
            heard(message_types(False).deserialize_cdr(data, kind))

    def subscribers(self, topic: str) -> int:
        """Number of subscribers of a topic so far."""
        return self._matched[topic]

    def publish(self, topic: str, message: Any) -> None:
        """Send a message."""
        data = serialised(self._types[topic], message, is_ros1=False)
        self._send(f"msg {topic} {len(data)}\n".encode() + data)

    def close(self) -> None:
        """End."""
        self._process.kill()
        self._listener.join()
        with self._lock, self._process:
            pass  # closes its pipes
