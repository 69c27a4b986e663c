"""Candidate queries: possible locations of a target, by remembered objects, objects near, places.

Candidates come from rows of `queries/goals-*.rq` and from the placement table. Each has its chain
of facts.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kg.history.reports.comparison import PRESENT
from kg.history.timestamps import span
from kg.knowledge.ontology.catalogue import Catalogue
from kg.knowledge.placement.table import PlacementTable
from kg.model import vocabulary as v
from kg.model.place_names import plain_place
from kg.model.records import likeliest
from kg.model.shares import percent
from mapping.persistence import holds, listed_half_life
from planner.freespace.planning_map import (
    Place,
    PlanningMap,
    Row,
    UnexploredArea,
    number,
    text_or_none,
    time_or_none,
)
from planner.search.goals.known_objects import kinds_half_lives
from planner.search.goals.place_names import in_words
from planner.search.goals.search_facts import SearchFacts, TargetFacts
from planner.search.goals.search_goals import (
    evidence,
    label_of,
    observed,
    sourced,
    times,
    with_article,
)
from planner.search.goals.targets import Target
from planner.settings import BeliefSettings

Kind = Literal["known", "moved", "nearby", "place", "frontier"]

_ALL_SEEN = 0.95  # share of a floor from which on all of it counts as seen
_ALL_KEPT = 0.995  # chance to be still in place from which on no words are made of it
_BEARS = 0.1  # share of a probability from which on its source is named
#: first words of the reasons in the table that are statements of the ontology
_STATEMENTS = ("listed", "stated", "weight")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One possible location of a target, with its probability and its chain of facts."""

    target: int  # number of the target
    kind: Kind
    iri: str  # of the object or place
    label: str
    p_map: NDArray[np.float64]  # (2,) [m]; of a place its centre
    probability: float  # that the target is there; candidates overlap, so these do not add up
    facts: tuple[str, ...]  # the chain that leads there
    existence: float = 1.0  # of a known object, when it was last seen
    deviation: float | None = None  # [m] of a known object's position
    place: str | None = None  # IRI of the place that the candidate is in, or is
    noticed: float = 0.0  # of a place: chance that earlier views of a cell noticed a target in it
    room_kind: str = ""  # of a place: IRI of its likeliest category
    rooms: float = np.inf  # of a place: rooms of that kind that its probability is worth


def existence_of(row: Row, settings: BeliefSettings) -> float:
    """Existence of a remembered object; a robot that found it looked twice, or closely."""
    existence = number(row, "existence")
    is_found = row["foundBy"] is not None and row["own"] is None and existence >= PRESENT
    return max(existence, settings.found) if is_found else existence


class CandidateQueries:
    """The candidates of each target, from the facts of a search."""

    def __init__(self, facts: SearchFacts, settings: BeliefSettings) -> None:
        self._facts, self._settings = facts, settings
        self._table, self._now = facts.table, facts.now

    def things(self, index: int) -> tuple[Candidate, ...]:
        """Candidates of target `index` at known objects: its instances, and objects it is near."""
        facts = self._facts.of_targets[index]
        target, half_lives = facts.target, kinds_half_lives(facts.target, facts.remembered)
        once: dict[str, Row] = {}  # each object by its most probable reading
        for row in sorted(facts.remembered, key=lambda row: -number(row, "existence")):
            once.setdefault(str(row["iri"]), row)
        if target.thing is not None:  # it was seen itself: what it is usually near adds nothing
            once = {iri: row for iri, row in once.items() if iri == target.thing}
            return tuple(self._known(index, row, half_lives) for row in once.values())
        return (
            *(self._known(index, row, half_lives) for row in once.values()),
            *self._nearby(index, facts),
        )

    def places(self, index: int, ground: PlanningMap) -> tuple[Candidate, ...]:
        """Candidates for target `index` in every place, and beyond the frontiers of the floor."""
        facts = self._facts.of_targets[index]
        target, places = facts.target, self._facts.places
        half_life = min(kinds_half_lives(target, facts.remembered).values())
        rooms = _Rooms(self._table, target, facts.expected, self._facts.catalogue)
        if target.thing is not None:
            return self._moved_to(index, target, ground, half_life, rooms)
        return (
            *(self._place(index, place, rooms, half_life, ground) for place in places),
            *(self._beyond(index, target, area, rooms) for area in ground.unexplored),
        )

    def _moved_to(
        self, index: int, target: Target, ground: PlanningMap, half_life: float, rooms: _Rooms
    ) -> tuple[Candidate, ...]:
        """Places that may have the one object of a target, if it is no longer where it was."""
        here = sum(one.probability for one in self.things(index))
        moved = f"{target.label} is no longer where it was with {percent(1 - here)}"
        found = (
            self._place(index, place, rooms, half_life, ground) for place in self._facts.places
        )
        return tuple(
            replace(
                one,
                probability=one.probability * (1 - here),
                facts=(*one.facts, moved),
                noticed=0.0,
            )
            for one in found
        )

    def _known(self, index: int, row: Row, half_lives: Mapping[str, float]) -> Candidate:
        label, age = label_of(row), self._age(row)
        stated, existence = number(row, "existence"), existence_of(row, self._settings)
        half_life = half_lives[str(row["kind"])]
        kept = holds(half_life, age)
        where = self._facts.where(str(row["iri"]))
        category = with_article(str(row["category"]), self._facts.catalogue)
        fact = f"{label} is in the map, {where} ({evidence(row, stated, 'placeLabel')})"
        if existence > stated:
            fact += f"; a search found it ({existence:.2f})"
        if row["own"] is not None:
            seen = observed(row, "placeLabel")
            fact = f"{label} may be {category} ({existence:.2f}), {where}{seen}"
        facts = [fact]
        if kept < _ALL_KEPT:
            moved = f"{category} is moved within {span(half_life)} with 50 %"
            facts.append(f"{moved}; after {span(age)} it is still in place with {percent(kept)}")
        return Candidate(
            target=index,
            kind="known",
            iri=str(row["iri"]),
            label=label,
            p_map=np.array([number(row, "x"), number(row, "y")]),
            probability=existence * kept,
            facts=tuple(facts),
            existence=existence,
            deviation=None if row["deviation"] is None else number(row, "deviation"),
            place=text_or_none(row, "place"),
        )

    def _nearby(self, index: int, facts: TargetFacts) -> Iterable[Candidate]:
        found = [
            self._beside(index, queried, row)
            for queried, row in facts.beside
            if str(row["kind"]) not in facts.target.kinds
        ]
        best: dict[str, Candidate] = {}
        for candidate in sorted(found, key=lambda candidate: -candidate.probability):
            if candidate.probability > 0:
                best.setdefault(candidate.iri, candidate)
        return best.values()

    def _beside(self, index: int, queried: str, row: Row) -> Candidate:
        stated, existence = number(row, "relationProbability"), number(row, "existence")
        near = max(stated, self._table.near(queried, str(row["kind"])))
        kept = holds(listed_half_life(str(row["category"])), self._age(row))
        source = f", {row['source']}" if row["source"] else ""
        return Candidate(
            target=index,
            kind="nearby",
            iri=str(row["iri"]),
            label=label_of(row),
            p_map=np.array([number(row, "x"), number(row, "y")]),
            probability=existence * kept * near,
            facts=(
                f"{label_of(row)} is in the map ({evidence(row, existence, 'placeLabel')})",
                f"{row['wantedLabel']} is found near {row['category']} ({percent(near)}{source})",
            ),
            place=text_or_none(row, "place"),
        )

    def _place(
        self, index: int, place: Place, rooms: _Rooms, half_life: float, ground: PlanningMap
    ) -> Candidate:
        p, facts = rooms.of(place)
        kind = likeliest(place.beliefs) or v.PLACE
        noticed = 0.0
        if place.views > 0:
            age = self._now - (place.last_seen if place.last_seen is not None else self._now)
            kept = holds(half_life, age)
            noticed = self._settings.noticed * kept
            share = ground.seen_share(place.iri)
            p_noticed = self._settings.noticed * share
            p += (p * (1 - p_noticed) / (1 - p * p_noticed) - p) * kept
            part = f", {percent(share)} of its floor seen" if share < _ALL_SEEN else ""
            reason = f"viewed {times(place.views)}{part}, without another one: {percent(p)} left"
            facts = (*facts, reason)
        return Candidate(
            target=index,
            kind="place",
            iri=place.iri,
            label=place.name,
            p_map=np.array(place.centre),
            probability=p,
            facts=facts,
            place=place.iri,
            noticed=noticed,
            room_kind=kind,
            rooms=rooms.worth(kind),
        )

    def _beyond(self, index: int, target: Target, area: UnexploredArea, rooms: _Rooms) -> Candidate:
        """Candidate in a room that may lie beyond a frontier."""
        p_room, mean = self._settings.frontier, rooms.mean
        x, y = (float(c) for c in area.p_map)
        return Candidate(
            target=index,
            kind="frontier",
            iri=area.iri,
            label=area.label,
            p_map=area.p_map,
            probability=p_room * mean,
            facts=(
                f"the area beyond ({x:.1f}, {y:.1f}) was never seen; {area.width:.1f} m of free "
                "floor border on it",
                f"a room begins there with {percent(p_room)}, and a room of unknown kind "
                f"holds {target.label} with {percent(mean)}",
            ),
            place=area.iri,
        )

    def _age(self, row: Row) -> float:
        last = time_or_none(row, "lastSeen")
        return 0.0 if last is None else max(self._now - last.timestamp(), 0.0)


class _Rooms:
    """p(target in a place) by the categories that the place may have."""

    def __init__(
        self,
        table: PlacementTable,
        target: Target,
        expected: Iterable[Row],
        catalogue: Catalogue,
    ) -> None:
        self._table, self._target, self._catalogue = table, target, catalogue
        self._rows: dict[str, Row] = {}
        self._p_in = cache(self._probability_in)
        for row in expected:  # the likeliest first
            kind = str(row["kind"])
            if kind not in self._rows or _product(row) > _product(self._rows[kind]):
                self._rows[kind] = row
        #: p(target in a place of any kind), by how frequent rooms of each kind are in homes
        self.mean = sum(self._p_in(kind) * p for kind, p in table.room_frequencies.items())

    def _probability_in(self, kind: str) -> float:
        """p(target in a place of `kind`) by the table, or by a statement it lacks, if greater."""
        queried = self._target.queried
        p = 1 - float(np.prod([1 - self._table.probability(iri, kind) for iri in queried]))
        row = self._rows.get(kind)
        if row is None or _product(row) <= p or (row["near"] is None and self._has_statement(kind)):
            return p
        return min(_product(row), 1.0)

    def _has_statement(self, kind: str) -> bool:
        """Whether a statement in the table puts the target in this kind of place."""
        placements = (self._table.placement(iri, kind).reasons for iri in self._target.queried)
        return any(r.text.startswith(_STATEMENTS) for reasons in placements for r in reasons)

    def of(self, place: Place) -> tuple[float, tuple[str, ...]]:
        """Probability that `place` holds a target, and the facts for it."""
        total = max(sum(place.beliefs.values()), 1.0)
        share = {kind: belief / total for kind, belief in place.beliefs.items()}
        unknown = max(0.0, 1.0 - sum(share.values()))
        parts = {kind: belief * self._p_in(kind) for kind, belief in share.items()}
        p = sum(parts.values()) + unknown * self.mean
        if not place.views or not parts:
            holds_it = f"holds {self._target.label} with {percent(self.mean)}"
            reason = f"the kind of {place.name} is unknown"
            return p, (reason, f"a place of unknown kind {holds_it}")
        return p, self._facts(place, max(parts, key=lambda kind: (parts[kind], kind)))

    def worth(self, kind: str) -> float:
        """Rooms of `kind` that p(target in such a place) is worth: alpha + beta."""
        known = [self._table.placement(iri, kind) for iri in self._target.queried]
        return min(one.alpha + one.beta for one in known)

    def _facts(self, place: Place, kind: str) -> tuple[str, ...]:
        plain, label = plain_place(place.names[kind]), self._target.label
        a_category = with_article(plain)
        bare = place.name.removesuffix(f" ({plain})").removesuffix(f" (perhaps {plain})")
        name = in_words(self._catalogue, bare)
        is_one = f"the room called {plain} is one" if bare == plain else f"{name} is {a_category}"
        believed = f"{is_one} with {percent(place.beliefs[kind])}"
        row, p = self._rows.get(kind), self._p_in(kind)
        if row is None or p != min(_product(row), 1.0):  # the table has it, from several sources
            holds_it = f"{a_category} holds {label} with {percent(p)}"
            return believed, holds_it + self._sources(kind) + self._members(kind)
        sought = row["near"] or row["wanted"]
        where = with_article(plain_place(str(row["category"])))
        facts = [believed, f"{sought} is found in {where} {sourced(row, 'probability')}"]
        if row["near"] is not None:
            near = number(row, "nearProbability")
            facts.append(f"{row['wanted']} is found near {row['near']} ({percent(near)})")
        return (*facts, f"together {percent(p)}{self._members(kind)}")

    def _sources(self, kind: str) -> str:
        """The sources that bear most of p(target in a place of `kind`), with their shares."""
        best = max(self._target.queried, key=lambda iri: self._table.probability(iri, kind))
        borne = [r for r in self._table.placement(best, kind).reasons if r.share >= _BEARS]
        named = [f"{_source_words(r.source, r.text)} ({percent(r.share)})" for r in borne]
        return f", by {' and '.join(named)}" if named else ""

    def _members(self, kind: str) -> str:
        kinds = {k: label for k, label in self._target.kinds.items() if k != self._target.iri}
        if not kinds:
            return ""
        second = self._target.second
        by_chance = sorted(
            kinds, key=lambda k: (kinds[k] in second, -self._table.probability(k, kind), kinds[k])
        )
        shown = [f"{kinds[k]} {percent(self._table.probability(k, kind))}" for k in by_chance[:4]]
        return f" for any of {len(kinds)} kinds: {', '.join(shown)}" + (
            ", ..." if len(kinds) > len(shown) else ""
        )


def _source_words(source: str, text: str) -> str:
    if source == "model":
        return "how rare such things are"
    if source == "this map":
        return "the rooms of this map"
    return f"{text} in {source}" if text.endswith("rooms") else source


def _product(row: Row) -> float:
    near = 1.0 if row["nearProbability"] is None else number(row, "nearProbability")
    return number(row, "probability") * near
