"""Answers in sentences: where a target probably is, how often and when it was seen there.

The number in each sentence is the probability that the object still stands there: its existence,
and that it has not been moved since it was last seen (`mapping.persistence`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from kg.history.timestamps import span
from kg.knowledge.ontology.catalogue import Catalogue
from kg.maps.semantic_map import SemanticMap
from kg.model.errors import ModelError
from kg.model.shares import chance, percent
from mapping.looks.word_looks import compares_texts
from planner.search.goals.known_objects import LISTED, KnownObject, known_objects
from planner.search.goals.place_names import in_words
from planner.search.goals.search_goals import plural, times, with_article
from planner.search.goals.status import Value, status
from planner.search.goals.target_words import alike_here
from planner.search.goals.targets import Target

if TYPE_CHECKING:
    from planner.search.plans.search_state import PlanningState
    from planner.search.plans.view_plan import ViewPlan

SURELY: Final = 0.95  # probability from which on an object is said to be there, ...
PROBABLY: Final = 0.5  # ... to be there probably, ...
_PERHAPS: Final = 0.2  # ... and to be there perhaps; below, it was probably moved
_DOUBTED: Final = 3  # objects that are listed where none is sure
_NONE: Final[Mapping[Value, str]] = {
    "present": "",
    "gone": " any more",
    "looked, none seen": "",
    "hidden": ", but not everything was viewed",
    "never looked": ", but nobody looked",
}
_OTHERWISE: Final = 0.1  # least probability of another category that is named
_GUESS: Final = 0.01  # least probability of a place that is named as a guess


def find_sentences(
    semantic_map: SemanticMap,
    target: Target,
    now: float,
    state: PlanningState | None = None,
    found: ViewPlan | None = None,
    *,
    most: int = LISTED,
) -> list[str]:
    """Sentences about the known objects of a target, the most probable first, or about none.

    Args:
        semantic_map: The map.
        target: The target.
        now: Moment that ages count to [s since 1970].
        state: Planning state of the target; with it, rooms have probabilities.
        found: Plan on it; the room that is named for an unknown target is that of its first look.
        most: Number of objects that are listed.
    """
    known = known_of(semantic_map, target, state)
    looks = _looks(semantic_map, target)
    if known:
        rooms, shown = _room_probabilities(state), _shown_first(found)
        lines = answer_lines(known, now, target, rooms=rooms, shown=shown, most=most)
        return [*lines, *looks]
    guess = _guess(semantic_map.catalogue, target, state, found)
    if target.iri is None:
        return [f"{target.none} is in the map{guess}", *looks]
    fate = status(semantic_map, target.thing or target.iri)
    proof = fate.seen if guess else fate.proof  # the guess has a chance of its own
    return [f"{target.none} is in the map{_NONE[fate.value]}: {proof}{guess}", *looks]


def _looks(semantic_map: SemanticMap, target: Target) -> list[str]:
    """Sentences on things that look like a text with more than a category: ``red mug``."""
    if target.thing or not target.note or len(target.text.split()) < 2:
        return []
    if not compares_texts(semantic_map):
        return []
    try:
        found = alike_here(semantic_map, target.text)
    except ModelError as error:  # the category has its answer without the encoder
        return [str(error)[:1].upper() + str(error)[1:]]
    return [] if found is None else found.sentences(f"'{target.text}'")


def known_of(
    semantic_map: SemanticMap, target: Target, state: PlanningState | None = None
) -> Sequence[KnownObject]:
    """Known objects of a target, which a search that was planned for it has already."""
    of_targets = state.facts.of_targets if state is not None and state.facts is not None else ()
    found = [one.known for one in of_targets if one.target is target]
    return found[0] if found else known_objects(semantic_map, target)


def answer_lines(
    known: Sequence[KnownObject],
    now: float,
    target: Target | None = None,
    *,
    rooms: Mapping[str, float] | None = None,
    shown: Sequence[str] = (),
    most: int = LISTED,
) -> list[str]:
    """Known objects in sentences: whereabouts, sightings, probability to be there still.

    Args:
        known: Objects; the most probable are listed, or some doubted ones.
        now: Moment that ages count to [s since 1970].
        target: The word that they were found for.
        rooms: Probability that an object is in its room, by IRI.
        shown: IRIs of objects in the order in which a plan shows them; of those that are probably
            there, these come first.
        most: Number of objects that are listed.
    """
    second = frozenset[str]() if target is None else target.second
    at = {iri: number for number, iri in enumerate(shown)}

    def rank(one: KnownObject) -> tuple[bool, bool, bool, int, float]:
        p = one.still_there(now)
        order = at.get(one.iri, len(at)) if p >= PROBABLY else 0
        return not one.sure, one.category in second, p < PROBABLY, order, -p

    ranked = sorted(known, key=rank)
    listed = [one for one in ranked if one.sure][:most] or ranked[: min(most, _DOUBTED)]
    lines = [_sentence(one, now, rooms or {}) for one in listed]
    if rest := ranked[len(listed) :]:
        sure = [one for one in rest if one.sure]
        kinds = Counter(one.category for one in sure or rest)
        named = (f"{n} {kind if n == 1 else plural(kind)}" for kind, n in kinds.most_common())
        of = f": {', '.join(named)}" if target is not None and len(target.kinds) > 1 else ""
        doubted = len(rest) - len(sure)
        others = f", and perhaps {doubted} other{'s' * (doubted > 1)}" if doubted else ""
        more = f"{len(sure)} more{of}{others}" if sure else f"perhaps {doubted} more{of}"
        lines.append(f"and {more}")
    return lines


def _shown_first(found: ViewPlan | None) -> list[str]:
    """IRIs of the known objects that a plan looks for, in the order of its looks."""
    reasons = (reason for step in (found.steps if found else ()) for reason in step.why)
    return list(
        dict.fromkeys(one.candidate.iri for one in reasons if one.candidate.kind == "known")
    )


def _sentence(one: KnownObject, now: float, rooms: Mapping[str, float]) -> str:
    p, kept = one.still_there(now), one.kept(now)
    title = one.label + (one.stated.words(one.label) if one.stated else "")
    is_no = "may be" if one.existence >= _PERHAPS else "is probably"
    name = f"{title}, which {is_no} no {one.category}," if one.doubted else title
    if one.own is not None:
        name += f", which may be {with_article(one.category)},"
    seen = _sightings(one, now)
    still = " still" if kept < SURELY else ""
    if p < _PERHAPS and still and (one.sure or kept < _PERHAPS):
        room = rooms.get(one.iri, 0.0)
        room_too = f", in the same room with {percent(room)}" if room >= p + _GUESS else ""
        there = f"still there with {chance(p)}{room_too}"
        return f"Probably no longer {one.where}: {name} {seen} ({there}){_besides(one)}"
    lead = "Probably" if p >= PROBABLY and one.sure else "Perhaps"
    if p >= SURELY or one.existence < _PERHAPS:  # that it is nothing is said of the thing itself
        lead = ""
    where = f"{lead}{still} {one.where}".strip() if lead else one.where.strip()
    where = f"{where[:1].upper()}{where[1:]}"
    return f"{where}: {name} {seen} ({chance(p)} sure){_besides(one)}"


def _sightings(one: KnownObject, now: float) -> str:
    seen = "was seen there"
    if one.stated is not None and one.stated.detected_as:  # they are counts of the detectors' label
        seen = f"was detected there as {one.stated.detected_as}"
    if one.last_seen is None:
        return f"{seen} {times(one.observations)}" if one.observations else "is known"
    age = max(now - one.last_seen.timestamp(), 0.0)
    last = f"{span(age)} ago" if age >= 1 else "just now"
    if one.observations == 1:
        return f"{seen} once, {last}"
    return f"{seen} {times(one.observations)}, last {last}"


def _besides(one: KnownObject) -> str:
    """Other categories, and the search that found the object."""
    words = ""
    if one.own is None and one.may_be:
        others = (f"{with_article(k)} ({percent(p)})" for k, p in one.may_be if p >= _OTHERWISE)
        named = " or ".join(others)
        words = f"; it may also be {named}" if named else ""
    if one.found_by is not None:
        words += "; found by a search"
    return words


def _room_probabilities(state: PlanningState | None) -> dict[str, float]:
    """Probability that each known object is in the room where it was seen, by IRI."""
    if state is None:
        return {}
    belief = state.target_belief
    room = state.space.room.reshape(-1)[belief.cells]
    number = {iri: n for n, iri in enumerate(state.rooms)}
    found = dict[str, float]()
    for part in belief.parts:
        one = part.candidate
        if one.kind in ("known", "moved") and one.place in number:
            here = float(part.weight[room == number[one.place]].sum())
            found[one.iri] = found.get(one.iri, 0.0) + here
    return found


def _guess(
    catalogue: Catalogue, target: Target, state: PlanningState | None, found: ViewPlan | None
) -> str:
    """The place to look first for a target that is not in the map, or the likeliest; or ""."""
    if state is None:
        return ""
    weight = state.target_belief.weight[
        [state.targets[number] is target for number in state.target_belief.target]
    ].sum(axis=0)
    room = state.space.room.reshape(-1)[state.target_belief.cells]
    p = np.array([float(weight[room == number].sum()) for number in range(len(state.rooms))])
    best = int(np.argmax(p)) if len(p) else 0
    if not len(p) or p[best] < _GUESS:
        return ""
    first = found.steps[0] if found is not None and found.steps else None
    reason = first.why[0].candidate if first is not None and first.why else None
    if first is None or (reason is not None and state.targets[reason.target] is not target):
        likeliest = in_words(catalogue, state.room_names[best])
        return f"; if it is here, then most probably in {likeliest}"
    shown = None if reason is None else reason.place
    place = state.rooms.index(shown if shown in state.rooms else first.place)
    lead = "in"
    if state.rooms[place] != first.place:
        lead = f"from {in_words(catalogue, first.place_name)} into"
    return f"; the first look is {lead} {in_words(catalogue, state.room_names[place])}"
