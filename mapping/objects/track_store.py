"""Track store: the tracks of a mapper, beside its map, so that a run that ended goes on as it was.

The map holds facts; a track also knows its evidence, viewpoints and boxes, and candidates are no
facts at all. The rows of a transaction are written before it, marked with its number, and the
former ones are kept until the next: of a run that was killed between the two the former ones hold.
Nothing depends on the file. Where it is missing, foreign or damaged, tracks start from the facts.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.model.records import Evidence
from mapping.objects.absence import Absence
from mapping.objects.existence import CategoryEvidence
from mapping.objects.settings import ObjectSettings
from mapping.objects.tracks import Track

FILE: Final = "tracks.sqlite"
MAX_BYTES: Final = 1 << 28  # of a file that is read
_VERSION: Final = 2
_SCHEMA: Final = (
    "CREATE TABLE tracks (number INTEGER, mark INTEGER, state TEXT, boxes BLOB,"
    " PRIMARY KEY (number, mark))"
)
_RUN: Final = 0  # number of the row that holds what belongs to no track
_PLAIN: Final = (
    *("iri", "size", "looks", "absent", "peak", "observations", "weight"),
    *("first_seen", "last_seen", "last_frame", "place"),
)


@dataclass(slots=True)
class RunState:
    """What a run knows beside its tracks."""

    frame: int = 0  # number of the last one
    stamp: float = 0.0  # [s] of the last one
    looked_from: dict[str, list[list[float]]] = field(default_factory=dict)  # detector -> pose


class TrackStore:
    """Store of tracks in the folder of a map."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._known: set[int] = set()  # numbers of the tracks that it holds
        self._file: sqlite3.Connection | None = None

    def load(self, sequence: int, settings: ObjectSettings) -> tuple[list[Track], RunState]:
        """Tracks as they were when the map's last transaction was number `sequence`."""
        try:
            self._file = self._opened()
            rows = {number: (state, boxes) for number, state, boxes in self._rows(sequence)}
            run = RunState(**json.loads(rows.pop(_RUN, ("{}", b""))[0]))
            tracks = [
                _track(number, json.loads(state), boxes, settings)
                for number, (state, boxes) in sorted(rows.items())
                if state is not None
            ]
        except (sqlite3.Error, OSError, ValueError, TypeError, KeyError, RecursionError):
            self._discard()
            return [], RunState()
        self._known = {track.number for track in tracks}
        return tracks, run

    def save(self, tracks: Iterable[Track], run: RunState, mark: int) -> None:
        """Write the tracks that changed, to hold from transaction number `mark` on."""
        if self._file is None:
            return
        present = {track.number: track for track in tracks}
        rows: list[tuple[int, int, str | None, bytes | None]] = [
            (number, mark, json.dumps(_state(track)), _boxes(track))
            for number, track in present.items()
            if track.changed or number not in self._known
        ]
        rows += [(number, mark, None, None) for number in self._known - present.keys()]
        rows.append((_RUN, mark, json.dumps(asdict(run)), None))
        former = [(row[0], row[0], mark) for row in rows]
        try:
            with self._file as file:
                file.executemany(
                    "DELETE FROM tracks WHERE number = ? AND mark <"
                    " (SELECT MAX(mark) FROM tracks WHERE number = ? AND mark < ?)",
                    former,
                )
                file.executemany("INSERT OR REPLACE INTO tracks VALUES (?, ?, ?, ?)", rows)
        except sqlite3.Error:
            self._discard()
            return
        for track in present.values():
            track.changed = False
        self._known = set(present)

    def _opened(self) -> sqlite3.Connection:
        if self._path.is_symlink() or (
            self._path.exists() and self._path.stat().st_size > MAX_BYTES
        ):
            raise ValueError("not a store of tracks")
        file = sqlite3.connect(self._path, isolation_level="IMMEDIATE", check_same_thread=False)
        file.execute("PRAGMA trusted_schema = OFF")
        schema = [sql for (sql,) in file.execute("SELECT sql FROM sqlite_master") if sql]
        (version,) = file.execute("PRAGMA user_version").fetchone()
        if schema and (schema, version) != ([_SCHEMA], _VERSION):
            file.close()
            raise ValueError("another version")
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("PRAGMA synchronous = NORMAL")
        if not schema:
            file.execute(_SCHEMA)
            file.execute(f"PRAGMA user_version = {_VERSION}")
        return file

    def _rows(self, sequence: int) -> Iterator[tuple[int, str, bytes]]:
        """Number, state and boxes by mark; rows that the map's transactions do not reach go."""
        assert self._file is not None
        with self._file as file:
            file.execute("DELETE FROM tracks WHERE mark > ?", (sequence,))
        yield from self._file.execute("SELECT number, state, boxes FROM tracks ORDER BY mark")

    def _discard(self) -> None:
        """Start anew; where that fails, nothing is kept."""
        if self._file is not None:
            self._file.close()
        self._known, self._file = set(), None
        try:
            for suffix in ("", "-wal", "-shm"):
                Path(f"{self._path}{suffix}").unlink(missing_ok=True)
            self._file = self._opened()
        except (sqlite3.Error, OSError, ValueError):
            self._file = None

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def _state(track: Track) -> dict[str, Any]:
    """A track but for its boxes, as plain values."""
    return {name: getattr(track, name) for name in _PLAIN} | {
        "p_map": track.p_map.tolist(),
        "evidence": {c: [e.strength, e.looks] for c, e in track.evidence.items()},
        "absence": asdict(track.absence),
        "viewpoints": [[*view, looks] for view, looks in track.viewpoints.items()],
        "clear_views": sorted(track.clear_views),
        "together": [[number, times] for number, times in track.together.items()],
        "best": None if track.best is None else asdict(track.best),
        "labels": track.labels,
    }


def _boxes(track: Track) -> bytes:
    """Numbers of sizes and of boxes, then the sizes, the boxes' corners, and the track's own."""
    parts = [[len(track.sizes), len(track.lows)], track.sizes]
    corners = [*track.lows, *track.highs, track.low, track.high]
    return np.concatenate([*map(np.asarray, parts), *corners]).astype(np.float64).tobytes()


def _track(number: int, state: Mapping[str, Any], boxes: bytes, s: ObjectSettings) -> Track:
    values = np.frombuffer(boxes, np.float64)
    sizes, count = int(values[0]), int(values[1])
    corners = values[2 + sizes :].reshape(2 * count + 2, 3).copy()
    p_map: NDArray[np.float64] = np.array(state["p_map"], np.float64).reshape(3)
    plain = {name: state[name] for name in _PLAIN}
    track = Track(p_map=p_map, settings=s, number=number, changed=False, **plain)
    track.sizes.extend(values[2 : 2 + sizes].tolist())
    track.lows.extend(corners[:count])
    track.highs.extend(corners[count : 2 * count])
    track.low, track.high = corners[-2], corners[-1]
    track.evidence = {c: CategoryEvidence(*held) for c, held in state["evidence"].items()}
    track.absence = Absence(**state["absence"])
    track.viewpoints = {tuple(view): looks for *view, looks in state["viewpoints"]}
    track.clear_views = {tuple(view) for view in state["clear_views"]}
    track.together = {int(other): int(times) for other, times in state["together"]}
    track.labels = {str(c): float(p) for c, p in state["labels"].items()}
    if state["best"] is not None:
        best = dict(state["best"])
        track.best = Evidence(**best | {"box": tuple(best["box"])})
    numbers = [track.size, track.looks, track.weight, track.first_seen, track.last_seen]
    if not all(map(math.isfinite, numbers)) or not np.isfinite(values).all():
        raise ValueError("a number that is not finite")
    return track
