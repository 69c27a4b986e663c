"""Track store: the tracks of a mapper beside its map, in step with changes of other writers.

The map holds facts. A track also has evidence, viewpoints and boxes, and candidates are no facts.
The rows of a transaction are written before the transaction and marked with its number. The former
rows are kept until the next one: they hold if the run is killed between the two writes. Nothing
depends on the file. Where it is missing, foreign or damaged, tracks start from the facts; a file
that cannot be read is told in a warning.
"""

from __future__ import annotations

import json
import logging
import sqlite3
from base64 import b64decode, b64encode
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.model.areas import OrientedBox
from kg.model.records import Evidence, ObjectRecord
from kg.model.sqlite_files import open_sqlite, remove_sqlite, unreadable
from mapping.frames.sighting import ThingSighting
from mapping.objects.absence import Absence
from mapping.objects.existence import CategoryEvidence, logit
from mapping.objects.extents.box_fit import MAX_VIEWS, NUMBERS, pose_of
from mapping.objects.object_cache import ObjectCache
from mapping.objects.settings import ObjectSettings
from mapping.objects.track_updater import TrackUpdater
from mapping.objects.tracks import Track, Viewpoint, numbers, same_facts, track_of, viewpoint

FILE: Final = "tracks.sqlite"
MAX_BYTES: Final = 1 << 28  # of a file that is read
_VERSION: Final = 4
_SCHEMA: Final = (
    "CREATE TABLE tracks (number INTEGER, mark INTEGER, state TEXT, PRIMARY KEY (number, mark))"
)
_RUN: Final = 0  # number of the row that holds the state of the run
_PLAIN: Final = (
    *("iri", "size", "looks", "absent", "peak", "observations", "weight"),
    *("first_seen", "last_seen", "last_frame", "place", "shown", "grown", "early"),
)
_POINTS: Final = ("p_map", "low", "high")
_DAMAGE: Final = (sqlite3.Error, OSError, ValueError, TypeError, KeyError, RecursionError)
_WITHOUT: Final = (
    "mapping goes on from the objects of the map, without the evidence and the candidates of "
    "earlier frames, and begins the file anew"
)

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class RunState:
    """State of a run beside its tracks."""

    frame: int = 0  # number of the last frame
    stamp: float = 0.0  # [s] of the last frame
    looked_from: dict[str, list[list[float]]] = field(default_factory=dict)  # detector -> pose
    viewpoints: list[Viewpoint] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raise ValueError or TypeError for other types, as of a damaged file."""
        self.frame, self.stamp = int(self.frame), float(self.stamp)
        self.viewpoints = [tuple(map(int, view)) for view in self.viewpoints]


class TrackStore:
    """Store of tracks in the folder of a map."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._stored: set[int] = set()  # numbers of the tracks that it holds
        self._file: sqlite3.Connection | None = None

    def load(self, sequence: int, settings: ObjectSettings) -> tuple[list[Track], RunState]:
        """Tracks as they were when the map's last transaction was number `sequence`."""
        try:
            self._file = self._opened()
            with self._file as file:  # rows that the map's transactions do not reach
                file.execute("DELETE FROM tracks WHERE mark > ?", (sequence,))
            rows = dict(self._file.execute("SELECT number, state FROM tracks ORDER BY mark"))
            run = RunState(**json.loads(rows.pop(_RUN, "{}")))
            self._file.set_progress_handler(None, 0)
            tracks = [
                _track(number, json.loads(state), settings)
                for number, state in sorted(rows.items())
                if state is not None
            ]
        except _DAMAGE as error:
            _log.warning("%s", unreadable(self._path, error, _WITHOUT))
            self._discard()
            return [], RunState()
        self._stored = {track.number for track in tracks}
        return tracks, run

    def save(self, tracks: Iterable[Track], run: RunState, mark: int) -> None:
        """Write the tracks that changed, to hold from transaction number `mark` on."""
        if self._file is None:
            return
        present = {track.number: track for track in tracks}
        rows: list[tuple[int, int, str | None]] = [
            (number, mark, json.dumps(_state(track)))
            for number, track in present.items()
            if track.changed or number not in self._stored
        ]
        rows += [(number, mark, None) for number in self._stored - present.keys()]
        rows.append((_RUN, mark, json.dumps(_plain(run))))
        former = [(row[0], row[0], mark) for row in rows]
        try:
            with self._file as file:
                file.executemany(
                    "DELETE FROM tracks WHERE number = ? AND mark <"
                    " (SELECT MAX(mark) FROM tracks WHERE number = ? AND mark < ?)",
                    former,
                )
                file.executemany("INSERT OR REPLACE INTO tracks VALUES (?, ?, ?)", rows)
        except sqlite3.Error:
            self._discard()
            return
        for track in present.values():
            track.changed = False
        self._stored = set(present)

    def _opened(self) -> sqlite3.Connection:
        return open_sqlite(self._path, [_SCHEMA], _VERSION, MAX_BYTES)

    def _discard(self) -> None:
        """Start anew; where that fails, nothing is kept."""
        if self._file is not None:
            self._file.close()
        self._stored, self._file = set(), None
        try:
            remove_sqlite(self._path)
            self._file = self._opened()
        except (sqlite3.Error, OSError, ValueError):
            self._file = None

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None


def tracks_damage(folder: Path, *, live: bool = False) -> str:
    """A line about tracks that cannot be read in the folder of a map; "" for good ones or none."""
    path = folder / FILE
    if not (path.exists() or path.is_symlink()):
        return ""
    try:
        how = {"read_only": True, "live": live}
        with closing(open_sqlite(path, [_SCHEMA], _VERSION, MAX_BYTES, **how)) as file:
            for number, state in file.execute("SELECT number, state FROM tracks"):
                if number == _RUN:
                    RunState(**json.loads(state))
                elif state is not None:
                    _track(number, json.loads(state), ObjectSettings())
    except _DAMAGE as error:
        return unreadable(path, error, _WITHOUT)
    return ""


def seen_from(
    folder: Path | None, iris: Collection[str], *, live: bool = False
) -> dict[str, NDArray[np.float64]]:
    """Camera poses (n, 3, 4), T_map_cam, from which each of the objects `iris` was detected.

    Up to `MAX_VIEWS` of each; none for a map without a folder here, or whose tracks cannot be read.
    """
    if folder is None or not iris or not (folder / FILE).exists():
        return {}
    query = (
        "SELECT json_extract(state, '$.iri'), json_extract(state, '$.views') FROM tracks"
        " WHERE json_extract(state, '$.iri') IN (SELECT value FROM json_each(?)) ORDER BY mark"
    )
    how = {"read_only": True, "live": live}
    try:
        with closing(open_sqlite(folder / FILE, [_SCHEMA], _VERSION, MAX_BYTES, **how)) as file:
            found = dict(file.execute(query, (json.dumps([*iris]),)))
        views = {
            iri: np.frombuffer(b64decode(views), np.float32).reshape(-1, NUMBERS)[:MAX_VIEWS]
            for iri, views in found.items()
        }
    except _DAMAGE:
        return {}
    poses = {iri: rows[:, :12].reshape(-1, 3, 4).astype(np.float64) for iri, rows in views.items()}
    return {iri: of for iri, of in poses.items() if np.isfinite(of).all()}


def _plain(record: RunState | Absence | Evidence) -> dict[str, Any]:
    """A record's fields; `dataclasses.asdict` takes ten times as long, since it copies them."""
    return {name: getattr(record, name) for name in record.__slots__}


def _state(track: Track) -> dict[str, Any]:
    """A track as plain values."""
    return {name: getattr(track, name) for name in _PLAIN} | {
        **{name: getattr(track, name).tolist() for name in _POINTS},
        "sizes": [*track.sizes],
        "lows": _packed(track.lows, np.float64),
        "highs": _packed(track.highs, np.float64),
        "evidence": {c: [e.strength, e.looks] for c, e in track.evidence.items()},
        "absence": _plain(track.absence),
        "viewpoints": [[*view, looks] for view, looks in track.viewpoints.items()],
        "clear_views": sorted(track.clear_views),
        "together": [[number, times] for number, times in track.together.items()],
        "best": None if track.best is None else _plain(track.best),
        "labels": track.labels,
        "views": _packed(track.views.values(), np.float32),
        "box": None if (box := track.box) is None else [*box.centre, *box.extent, box.yaw],
    }


def _packed(rows: Iterable[NDArray[np.floating]], kind: type[np.floating]) -> str:
    """Rows of numbers as text; decimals would take ten times as long."""
    return b64encode(np.array([*rows], kind).tobytes()).decode()


def _corners(packed: str | list[list[float]]) -> NDArray[np.float64]:
    """Corners (n, 3) [m] of boxes; files of earlier releases have them as decimals."""
    if isinstance(packed, str):
        return np.frombuffer(b64decode(packed)).reshape(-1, 3)
    return np.array(packed, np.float64).reshape(-1, 3)


def _track(number: int, state: Mapping[str, Any], s: ObjectSettings) -> Track:
    plain = {n: state[n] for n in _PLAIN if n != "early" or n in state}  # older files have none
    points: dict[str, Any] = {
        name: np.array(state[name], np.float64).reshape(3) for name in _POINTS
    }
    lows, highs = _corners(state["lows"]), _corners(state["highs"])
    track = Track(**points, **plain, settings=s, number=number, changed=False)
    track.sizes.extend(map(float, state["sizes"]))
    track.lows.extend(lows)
    track.highs.extend(highs)
    track.evidence = {c: CategoryEvidence(*held) for c, held in state["evidence"].items()}
    track.absence = Absence(**state["absence"])
    track.viewpoints = {tuple(view): looks for *view, looks in state["viewpoints"]}
    track.clear_views = {tuple(view) for view in state["clear_views"]}
    track.together = {int(other): int(times) for other, times in state["together"]}
    track.labels = {str(c): float(p) for c, p in state["labels"].items()}
    rows = np.frombuffer(b64decode(state["views"]), np.float32).reshape(-1, NUMBERS)
    if not np.isfinite(rows).all():
        raise ValueError("a view that is not finite")
    track.views = {viewpoint(pose_of(row)): row for row in rows[:MAX_VIEWS]}
    if (box := state["box"]) is not None:
        sides = np.array(box, np.float64).reshape(7)
        track.box = OrientedBox(sides[:3], sides[3:6], float(sides[6]))
        if not ((sides[3:6] > 0).all() and abs(sides[6]) <= np.pi):
            raise ValueError("a box without sides")
    if state["best"] is not None:
        best = dict(state["best"])
        track.best = Evidence(**best | {"box": tuple(best["box"])})
    numbers = [track.size, track.looks, track.weight, track.first_seen, track.last_seen]
    numbers += [track.shown, track.grown, track.early, *(box or ())]
    boxes = (*points.values(), *lows, *highs, track.sizes)
    if len(lows) != len(highs) or not all(np.isfinite(part).all() for part in (*boxes, numbers)):
        raise ValueError("a number that is not finite")
    return track


_NEARBY = 6.0  # [m] tracks farther from every sighting are skipped


class TrackedThings:
    """The tracks of a map's objects, and of candidates; `objects` is the map's cache.

    A map without a folder here, or open for reading, stores no tracks.
    """

    def __init__(
        self,
        semantic_map: SemanticMap,
        objects: ObjectCache,
        settings: ObjectSettings,
        updater: TrackUpdater,
    ) -> None:
        self._map, self._objects, self._settings = semantic_map, objects, settings
        self._updater = updater
        self.catalogue = semantic_map.catalogue
        folder = None if semantic_map.store.read_only else semantic_map.store.path
        self._store = None if folder is None else TrackStore(folder)
        self.run = RunState()
        self.tracks: list[Track] = self._loaded()

    def save(self, sequence: int) -> None:
        """Store the tracks beside the map, before its transaction of that number."""
        if self._store is not None:
            self.run.frame, self.run.stamp = self._updater.frame, self._updater.stamp
            self.run.viewpoints = sorted(self._updater.viewpoints)
            self._store.save(self.tracks, self.run, sequence)

    def positions(self) -> NDArray[np.float64]:
        """(n, 3) [m] of all tracks."""
        if not self.tracks:
            return np.zeros((0, 3))
        return np.array([track.p_map for track in self.tracks])

    def near(self, sightings: Sequence[ThingSighting]) -> list[Track]:
        """Tracks that any of the sightings may show, by where they are perceived or asserted."""
        if not sightings or not self.tracks:
            return []
        centre = np.mean([sighting.p_map for sighting in sightings], axis=0)
        reach = _NEARBY + max(float(np.linalg.norm(x.p_map - centre)) for x in sightings)
        offsets = np.linalg.norm(self.positions() - centre, axis=1)
        return [
            track
            for track, offset in zip(self.tracks, offsets, strict=True)
            if offset < reach or self.asserted(track)[0] is not None
        ]

    def asserted(self, track: Track) -> tuple[NDArray[np.float64] | None, str | None]:
        """Position and category of a track as people assert them, where they differ from ours."""
        return self._objects.asserted(track.iri)

    def remove(self, gone: Collection[Track]) -> None:
        """Forget these tracks."""
        ids = {id(track) for track in gone}
        if ids:
            self.tracks = [track for track in self.tracks if id(track) not in ids]

    def forget_candidates(self) -> None:
        """Forget candidates that are improbable, or that were not seen for long."""
        s, least = self._settings, logit(self._settings.removed)
        self.tracks = [
            track
            for track in self.tracks
            if track.iri is not None
            or (
                max(track.log_odds.values()) > least
                and self._updater.frame - track.last_frame < s.forgotten
            )
        ]

    def refresh(self, touched: frozenset[str]) -> None:
        """Begin the tracks of objects anew that other writers changed, among the IRIs `touched`."""
        held = self._objects.perceived
        kept = list[Track]()
        for track in self.tracks:
            if track.iri not in touched:
                kept.append(track)
            elif track.iri in held:
                same = track.written is not None and same_facts(track.written, held[track.iri])
                kept.append(track if same else self._track(held[track.iri]))
        known = {track.iri for track in kept}
        self.tracks = kept + [
            self._track(held[iri])
            for iri in touched
            if iri in held and iri not in known and _is_tracked(held[iri])
        ]

    def forget_categories(self, departed: Sequence[Track]) -> None:
        """Forget categories that left the ontology, and things without evidence of others.

        Tracks of `departed` objects lose the categories, too.
        """
        self.catalogue = self._map.catalogue
        for track in [*self.tracks, *departed]:
            unknown = [c for c in track.evidence if self.catalogue.by_iri(c) is None]
            for category in unknown:
                del track.evidence[category]
            if unknown and track.evidence:
                self._updater.assess(track)
        gone = [track.iri for track in self.tracks if track.iri and not track.evidence]
        self._objects.remove(iri for iri in gone if iri in self._objects.perceived)
        self.tracks = [track for track in self.tracks if track.evidence]

    def _loaded(self) -> list[Track]:
        """The tracks that are stored beside the map, and those of all other objects."""
        stored = list[Track]()
        if self._store is not None:
            stored, self.run = self._store.load(self._map.sequence, self._settings)
            numbers.reserve(track.number for track in stored)
            self._updater.frame, self._updater.stamp = self.run.frame, self.run.stamp
            self._updater.viewpoints = {*self.run.viewpoints}
        tracks, held = list[Track](), dict(self._objects.perceived)
        for track in stored:
            if any(self.catalogue.by_iri(category) is None for category in track.evidence):
                continue
            self._updater.reassess(track)
            if track.iri is not None:
                record = held.get(track.iri)
                if record is None or not same_facts(track.record(), record):
                    continue
                track.written = held.pop(track.iri)
            track.changed = False
            tracks.append(track)
        return tracks + [self._track(record) for record in held.values() if _is_tracked(record)]

    def _track(self, record: ObjectRecord) -> Track:
        return track_of(record, self._settings, self._updater.usual_size)


def _is_tracked(record: ObjectRecord) -> bool:
    """Whether detections decide about an object; `mapping.things` does of those it found."""
    return record.category != v.UNNAMED_THING
