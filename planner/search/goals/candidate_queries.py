"""Candidate queries: where a target may be by known objects, neighbours and kinds of places.

Everything comes from rows of `queries/goals-*.rq` and from the placement table; each candidate
carries its chain of facts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kg.knowledge.placement.table import PlacementTable
from kg.maps.query.evaluation import Value
from kg.maps.semantic_map import SemanticMap
from mapping.persistence import holds, learned_half_life, listed_half_life
from planner.freespace.planning_map import Place, PlanningMap, Row, UnexploredArea, number
from planner.search.goals.search_goals import seen, times, whereabouts
from planner.search.goals.targets import Target
from planner.settings import BeliefSettings

Kind = Literal["known", "nearby", "place", "frontier"]

_ALL_SEEN = 0.95  # share of a floor that is called all of it
#: how the table words a reason that is a statement of the ontology
_STATEMENTS = ("listed", "stated", "weight")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One possible location of a target, with its probability and its chain of facts."""

    target: int  # number of the target
    kind: Kind
    iri: str  # of the object or place
    label: str
    p_map: NDArray[np.float64]  # (2,) [m]; of a place its centre
    probability: float  # that it is there; candidates overlap, so these do not add up
    facts: tuple[str, ...]  # the chain that leads there
    existence: float = 1.0  # of a known object, when it was last seen
    place: str | None = None  # IRI of the place it is in, or is
    noticed: float = 0.0  # of a place: chance that it would be known of, lay it where was seen


def map_time(semantic_map: SemanticMap) -> float:
    """[s] the latest time stamp in the map, of an observation or of a robot pose."""
    times = [
        row["lastSeen"].timestamp()
        for row in semantic_map.query("goals-last-seen").records()
        if isinstance(row["lastSeen"], datetime)
    ]
    robot = semantic_map.robot()
    return max(times + ([] if robot is None else [robot.stamp]), default=0.0)


class CandidateQueries:
    """Queries the graph for the candidates of each target."""

    def __init__(
        self,
        semantic_map: SemanticMap,
        places: Sequence[Place],
        table: PlacementTable,
        now: float,
        settings: BeliefSettings,
    ) -> None:
        self._map, self._places, self._table = semantic_map, places, table
        self._now, self._settings = now, settings
        self._labels = {place.iri: place.label for place in places}

    def things(self, number_: int, target: Target) -> tuple[Candidate, ...]:
        """Candidates at known objects: instances of the target, and objects it is found near."""
        known = self._remembered(target)
        life = self._half_lives(target, known)
        return (
            *(self._known(number_, row, life) for row in _each(known)),
            *self._nearby(number_, target),
        )

    def places(self, number_: int, target: Target, ground: PlanningMap) -> tuple[Candidate, ...]:
        """Candidates in every place, and beyond the frontiers of the floor."""
        life = self._half_lives(target, self._remembered(target))
        rooms = _Rooms(self._table, target, self._expected(target))
        return (
            *(self._place(number_, target, p, rooms, life, ground) for p in self._places),
            *(self._beyond(number_, target, one, rooms) for one in ground.unexplored),
        )

    def _remembered(self, target: Target) -> list[Row]:
        return [row for iri in target.queried for row in self._ask("goals-remembered", iri)]

    def _ask(self, question: str, category: str) -> list[dict[str, Value]]:
        return self._map.query(question, category=category).records()

    def _expected(self, target: Target) -> list[Row]:
        return [row for iri in target.queried for row in self._ask("goals-expected", iri)]

    def _half_lives(self, target: Target, rows: Iterable[Row]) -> dict[str, float]:
        stays: dict[str, list[float]] = {kind: [] for kind in target.kinds}
        for row in rows:
            first, last = row["firstSeen"], row["lastSeen"]
            if isinstance(first, datetime) and isinstance(last, datetime) and row["own"] is None:
                stays[str(row["kind"])].append((last - first).total_seconds())
        return {
            kind: learned_half_life(listed_half_life(label, target.above[kind]), stays[kind])
            for kind, label in target.kinds.items()
        }

    def _known(self, target: int, row: Row, life: Mapping[str, float]) -> Candidate:
        existence = number(row, "existence")
        half = life[str(row["kind"])]
        kept = holds(half, self._age(row))
        where = whereabouts(self._map, str(row["iri"]))
        fact = f"{name(row)} is in the map, {where} ({_seen(row, existence)})"
        if row["own"] is not None:
            may_be = f"may be {with_article(str(row['category']))} ({existence:.2f})"
            fact = f"{name(row)} {may_be}, {where}{seen(row, 'placeLabel')}"
        kind_of = str(row["category"])
        stays = f"{with_article(kind_of)} is moved within {span(half)} with probability 0.5"
        age = span(self._age(row))
        after = f", still in place after {age} with {kept:.2f}" if self._age(row) >= 1 else ""
        return Candidate(
            target=target,
            kind="known",
            iri=str(row["iri"]),
            label=name(row),
            p_map=_xy(row),
            probability=existence * kept,
            facts=(fact, stays + after),
            existence=existence,
            place=None if row["place"] is None else str(row["place"]),
        )

    def _nearby(self, number_: int, target: Target) -> Iterator[Candidate]:
        best: dict[str, Candidate] = {}
        known = set(target.kinds)
        for iri in target.queried:
            for row in self._ask("goals-beside", iri):
                if str(row["kind"]) in known:
                    continue
                found = self._beside(number_, iri, row)
                rival = best.get(found.iri)
                if found.probability > (rival.probability if rival else 0.0):
                    best[found.iri] = found
        yield from best.values()

    def _beside(self, number_: int, queried: str, row: Row) -> Candidate:
        stated, existence = number(row, "relationProbability"), number(row, "existence")
        near = max(stated, self._table.near(queried, str(row["kind"])))
        kept = holds(listed_half_life(str(row["category"])), self._age(row))
        source = f", {row['source']}" if row["source"] else ""
        return Candidate(
            target=number_,
            kind="nearby",
            iri=str(row["iri"]),
            label=name(row),
            p_map=_xy(row),
            probability=existence * kept * near,
            facts=(
                f"{name(row)} is in the map ({_seen(row, existence)})",
                f"{row['wantedLabel']} is found near {row['category']} ({near:.2g}{source})",
            ),
            place=None if row["place"] is None else str(row["place"]),
        )

    def _place(
        self,
        number_: int,
        target: Target,
        place: Place,
        rooms: _Rooms,
        life: Mapping[str, float],
        ground: PlanningMap,
    ) -> Candidate:
        p, facts = rooms.of(place)
        noticed = 0.0
        if place.views > 0:
            age = self._now - (place.last_seen if place.last_seen is not None else self._now)
            kept = holds(min(life.values()), age)
            noticed = self._settings.noticed * kept
            share = ground.seen_share(place.iri)
            would = self._settings.noticed * share
            p += (p * (1 - would) / (1 - p * would) - p) * kept
            part = f", {share:.0%} of its floor seen" if share < _ALL_SEEN else ""
            reason = f"viewed {times(place.views)}{part} with none more noticed: {p:.2f} left"
            facts = (*facts, reason)
        return Candidate(
            target=number_,
            kind="place",
            iri=place.iri,
            label=place.label,
            p_map=np.array(place.centre),
            probability=p,
            facts=facts,
            place=place.iri,
            noticed=noticed,
        )

    def _beyond(
        self, number_: int, target: Target, one: UnexploredArea, rooms: _Rooms
    ) -> Candidate:
        """Candidate in a room that may lie beyond a frontier."""
        room, mean = self._settings.frontier, rooms.mean
        x, y = (float(c) for c in one.p_map)
        return Candidate(
            target=number_,
            kind="frontier",
            iri=one.iri,
            label=one.label,
            p_map=one.p_map,
            probability=room * mean,
            facts=(
                f"nobody has seen what lies beyond ({x:.1f}, {y:.1f}), where {one.width:.1f} m of "
                "free floor end",
                f"a room begins there with {room:.2f}, and any kind of place holds "
                f"{target.label} with {mean:.2f}",
            ),
            place=one.iri,
        )

    def _age(self, row: Row) -> float:
        seen = row["lastSeen"]
        return max(self._now - seen.timestamp(), 0.0) if isinstance(seen, datetime) else 0.0


class _Rooms:
    """p(target in a place) by the categories that the place may have."""

    def __init__(self, table: PlacementTable, target: Target, expected: Iterable[Row]) -> None:
        self._table, self._target = table, target
        self._rows: dict[str, Row] = {}
        self._of_kind: dict[str, float] = {}
        for row in expected:  # the likeliest first
            kind = str(row["kind"])
            if kind not in self._rows or _product(row) > _product(self._rows[kind]):
                self._rows[kind] = row
        #: p(any kind of place holds it), by how frequent rooms of each kind are in homes
        self.mean = sum(self._in(kind) * p for kind, p in table.room_frequencies.items())

    def _in(self, kind: str) -> float:
        if kind not in self._of_kind:
            self._of_kind[kind] = self._worked_out(kind)
        return self._of_kind[kind]

    def _worked_out(self, kind: str) -> float:
        """Probability by the table, or by a statement that the table lacks, if greater."""
        queried = self._target.queried
        p = 1 - float(np.prod([1 - self._table.probability(iri, kind) for iri in queried]))
        row = self._rows.get(kind)
        if row is None or _product(row) <= p or (row["near"] is None and self._weighed(kind)):
            return p
        return min(_product(row), 1.0)

    def _weighed(self, kind: str) -> bool:
        """Whether a statement in the table puts the target in this kind of place."""
        weighed = (self._table.placement(iri, kind).reasons for iri in self._target.queried)
        return any(r.text.startswith(_STATEMENTS) for reasons in weighed for r in reasons)

    def of(self, place: Place) -> tuple[float, tuple[str, ...]]:
        """Probability that `place` holds one, and why."""
        total = max(sum(place.beliefs.values()), 1.0)
        share = {kind: belief / total for kind, belief in place.beliefs.items()}
        unknown = max(0.0, 1.0 - sum(share.values()))
        parts = {kind: belief * self._in(kind) for kind, belief in share.items()}
        p = sum(parts.values()) + unknown * self.mean
        if not place.views or not parts:
            reason = f"nobody has seen what kind of place {place.label} is"
            return p, (reason, f"any kind of place holds {self._target.label} with {self.mean:.2f}")
        return p, self._facts(place, max(parts, key=lambda kind: (parts[kind], kind)))

    def _facts(self, place: Place, kind: str) -> tuple[str, ...]:
        what, label = place.names[kind], self._target.label
        facts = [f"{place.label} is believed to be a {what} ({place.beliefs[kind]:.2f})"]
        row = self._rows.get(kind)
        if row is None:
            return (*facts, f"a {what} holds {label} with {self._in(kind):.2f}")
        where = f"{row['category']} is where to look for"
        source = f", {row['source']}" if row["source"] else ""
        reason = f"({number(row, 'probability'):g}{source})"
        if row["near"] is None:
            facts.append(f"{where} {row['wanted']} {reason}")
        else:
            facts.append(f"{where} {row['near']} {reason}")
            near = number(row, "nearProbability")
            facts.append(f"{row['wanted']} is found near {row['near']} ({near:g})")
        return (*facts, f"together {self._in(kind):.2f}{self._members(kind)}")

    def _members(self, kind: str) -> str:
        kinds = {k: label for k, label in self._target.kinds.items() if k != self._target.iri}
        if not kinds:
            return ""
        by_chance = sorted(kinds, key=lambda k: (-self._table.probability(k, kind), kinds[k]))
        shown = [f"{kinds[k]} {self._table.probability(k, kind):.2f}" for k in by_chance[:4]]
        return f" for any of {len(kinds)} kinds: {', '.join(shown)}" + (
            ", ..." if len(kinds) > len(shown) else ""
        )


def _product(row: Row) -> float:
    near = 1.0 if row["nearProbability"] is None else number(row, "nearProbability")
    return number(row, "probability") * near


def _each(rows: Iterable[Row]) -> Iterator[Row]:
    """Rows with each object once, by its most probable reading."""
    seen: set[Value] = set()
    for row in rows:
        if row["iri"] not in seen:
            seen.add(row["iri"])
            yield row


def name(row: Row) -> str:
    """Label of the object of a row, else its category."""
    return str(row["label"] or row["category"])


def with_article(noun: str) -> str:
    """As in ``an apple``."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"


def _xy(row: Row) -> NDArray[np.float64]:
    return np.array([number(row, "x"), number(row, "y")])


def _seen(row: Row, existence: float) -> str:
    return f"existence {existence:.2f}{seen(row, 'placeLabel')}"


def span(seconds: float) -> str:
    """A length of time in its largest fitting unit: ``12 h``."""
    for unit, length in (("years", 31557600.0), ("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
