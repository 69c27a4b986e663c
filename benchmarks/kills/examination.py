"""A map after a kill: is all there that was acknowledged, whole, numbered, and told alike?"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import CanonicalizationAlgorithm, Dataset, Literal, Quad, RdfFormat, parse

from benchmarks.kills.frames import BASE, NOTES, expected, expected_export, facts, note_update
from kg.history.storage.log import BACKGROUND
from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model import vocabulary as v
from kg.serving.opening import open_map


@dataclass(frozen=True, slots=True)
class Known:
    """The last transactions that a map is known to have."""

    frames: int = 0
    notes: int = 0
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class Finding:
    """Findings of an examination; `wrong` has a line for each violation."""

    known: Known
    digest: str
    wrong: tuple[str, ...]
    seconds: float = 0.0  # that the map took to open


def stated(quads: Iterable[Quad]) -> set[Quad]:
    """The quads of a store but those that it infers, which no history holds."""
    return {quad for quad in quads if quad.graph_name != v.INFERRED_GRAPH}


def examine(path: Path, before: Known, acknowledged: Known, *, read_only: bool) -> Finding:
    """Open the map as its users would and look at everything.

    `before` is what an earlier examination found, `acknowledged` what the killed process said it
    had done since.
    """
    started = time.monotonic()
    with open_map(path, read_only=read_only) as semantic_map:
        seconds = time.monotonic() - started
        known = _known(semantic_map)
        wrong = [
            *_lost(known, acknowledged),
            *_torn(semantic_map, known),
            *_misnumbered(semantic_map, known, before),
            *_retold(semantic_map, known, before),
        ]
        return Finding(known, digest(semantic_map.engine), tuple(wrong), seconds)


def examine_after_cut(path: Path, told: Known, *, power_safe: bool) -> Finding:
    """Open a map whose power was cut, and look at it.

    With `power_safe` all that was `told` is there; else a whole earlier state of the map.
    """
    started = time.monotonic()
    with open_map(path) as semantic_map:
        seconds = time.monotonic() - started
        known = _known(semantic_map)
        now = set(semantic_map.engine)
        with semantic_map.at(known.sequence) as then:
            wrong = differs(f"the history at #{known.sequence}", set(then.engine), now)
        wrong += _torn(semantic_map, known)
        if power_safe:
            wrong += _lost(known, told)
        semantic_map.update(note_update(known.notes + 1))
        if known.frames and semantic_map.sequence != known.sequence + 1:
            wrong.append(f"an update after #{known.sequence} is #{semantic_map.sequence}")
        return Finding(known, digest(semantic_map.engine), tuple(wrong), seconds)


def examine_mapped(path: Path, commits: int) -> Finding:
    """Open a map that a mapper wrote, whose log had so many transactions, and look at it."""
    started = time.monotonic()
    with open_map(path) as semantic_map:
        seconds = time.monotonic() - started
        number, now = semantic_map.sequence, set(semantic_map.engine)
        with semantic_map.at(number) as then:
            wrong = differs(f"the history at #{number}", set(then.engine), now)
        if number < commits:
            wrong.append(f"#{commits} was in the log, the map is at #{number}")
        if bool(semantic_map.recordings()) != (semantic_map.robot() is not None):
            wrong.append(f"#{number} has a recording without a robot, or the other way round")
        wrong += [f"{found.focus}: {found.message}" for found in check_map(semantic_map.engine)]
        return Finding(Known(), "", tuple(wrong), seconds)


def examine_export(file: Path, frames: int) -> Finding:
    """An exported map is whole: that of now, or an older one."""
    started = time.monotonic()
    quads = set(parse(path=str(file), format=RdfFormat.TRIG))
    seconds = time.monotonic() - started
    last = {int(q.object.value) for q in quads if q.predicate.value == v.SEQUENCE}
    there = max((number for number in last), default=0)
    wrong = differs(f"the export at #{there}", own_facts(quads), own_facts(expected_export(there)))
    if there > frames:
        wrong.append(f"the export is at #{there}, the map at #{frames}")
    return Finding(Known(there), "", tuple(wrong), seconds)


def replay(path: Path) -> tuple[str, tuple[str, ...]]:
    """The whole history of a map from its beginning, against the map; and the map's digest."""
    with open_map(path, read_only=True) as semantic_map:
        with semantic_map.at(0) as beginning:
            graph = stated(beginning.engine)
        for change in semantic_map.history.changes(0):
            graph -= set(change.removed)
            graph |= set(change.added)
        wrong = differs("the history from 0 on", graph, stated(semantic_map.engine))
        return isomorphic_digest(semantic_map.engine), tuple(wrong)


def digest(quads: Iterable[Quad]) -> str:
    """A fingerprint of what changes: all but ontology, common sense and the counter."""
    lines = sorted(
        str(q)
        for q in stated(quads)
        if q.graph_name not in BACKGROUND and q.predicate.value != v.SEQUENCE
    )
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def isomorphic_digest(quads: Iterable[Quad]) -> str:
    """A fingerprint of everything but the counter, whatever its blank nodes are called."""
    dataset = Dataset(q for q in stated(quads) if q.predicate.value != v.SEQUENCE)
    dataset.canonicalize(CanonicalizationAlgorithm.RDFC_1_0)
    lines = sorted(str(quad) for quad in dataset)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _known(semantic_map: SemanticMap) -> Known:
    recordings = semantic_map.recordings()
    notes = {
        int(quad.object.value)
        for quad in semantic_map.engine
        if quad.predicate.value == v.RDFS_COMMENT
        and "/note/" in str(quad.subject)
        and isinstance(quad.object, Literal)
    }
    frames = recordings[0].frames_applied if recordings else 0
    return Known(frames, max(notes, default=0), semantic_map.sequence)


def _lost(known: Known, acknowledged: Known) -> list[str]:
    wrong = []
    for what in ("frames", "notes"):
        there, told = getattr(known, what), getattr(acknowledged, what)
        # one more may have been written than was acknowledged, never one less
        if not told <= there <= told + 1:
            wrong.append(f"{told} {what} were acknowledged, {there} are there")
    return wrong


def _torn(semantic_map: SemanticMap, known: Known) -> list[str]:
    wanted = expected(known.frames, known.notes)
    name = f"the graph after {known.frames} frames and {known.notes} notes of {NOTES} facts"
    return differs(name, facts(semantic_map), wanted)


def _misnumbered(semantic_map: SemanticMap, known: Known, before: Known) -> list[str]:
    wrong = []
    if known.sequence != known.frames + known.notes:
        wrong.append(f"#{known.sequence} after {known.frames} frames and {known.notes} notes")
    if semantic_map.history.log.last != known.sequence:
        wrong.append(
            f"the log ends at #{semantic_map.history.log.last}, the map at #{known.sequence}"
        )
    numbers = [change.sequence for change in semantic_map.history.changes(before.sequence)]
    if numbers != list(range(before.sequence + 1, known.sequence + 1)):
        wrong.append(f"the log has {numbers} between #{before.sequence} and #{known.sequence}")
    return wrong


def _retold(semantic_map: SemanticMap, known: Known, before: Known) -> list[str]:
    now = set(semantic_map.engine)
    with semantic_map.at(known.sequence) as told:
        wrong = differs(f"the history at #{known.sequence}", set(told.engine), now)
    with semantic_map.at(before.sequence) as then:
        graph = stated(then.engine)
    for change in semantic_map.history.changes(before.sequence):
        graph -= set(change.removed)
        graph |= set(change.added)
    return wrong + differs(f"the changes since #{before.sequence}", graph, stated(now))


def differs(name: str, graph: set[Quad], wanted: set[Quad]) -> list[str]:
    """A line that says how a graph differs from the wanted one, or none."""
    graph, wanted = _uncounted(graph), _uncounted(wanted)
    if graph == wanted:
        return []
    example = min(map(str, graph ^ wanted))
    return [f"{name}: {len(wanted - graph)} facts lack, {len(graph - wanted)} too many: {example}"]


def own_facts(quads: Iterable[Quad]) -> set[Quad]:
    """Facts about the things of a map."""
    return {quad for quad in quads if str(quad.subject).startswith(f"<{BASE}object/")}


def _uncounted(quads: set[Quad]) -> set[Quad]:
    return {quad for quad in quads if quad.predicate.value != v.SEQUENCE}
