"""Questions on a house with their exact answers, drawn by seed.

Only what can be told is asked: no question is about a category of which a doubtful thing is in
question, and things near the border of an area count neither way.
"""

from __future__ import annotations

import itertools
import random
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

from lab.houses.small_things import MOVABLE
from lab.questions.house_drives import Doubtful, HouseFacts
from lab.questions.plain_map import NEVER, NOT_KNOWN, WHOLE, PlainMap, Thing, on_strip
from lab.questions.question_file import FAMILIES, HouseQuestion
from planner.simulation.house import OBJECTS

BORDER: Final = 0.3  # [m] by which a thing may be off, and count or not
RADIUS: Final = 1.5  # [m]
NEAR: Final = 0.5  # [m] tolerance of a position
SECONDS: Final = 60.0  # [s] tolerance of a time
_PLURALS: Final = {"knife": "knives", "mouse": "mice", "scissors": "pairs of scissors"}

Drawn = tuple[str, dict[str, Any], dict[str, Any]]  # text, parameters, other fields of the question


def questions_of(facts: HouseFacts, each: int) -> list[HouseQuestion]:
    """At most `each` questions of every family."""
    asker, found = _Asker(facts), list[HouseQuestion]()
    for family in FAMILIES:
        drawn = list(asker.families[family]())
        chance = random.Random(f"{facts.number}/{family}")
        chance.shuffle(drawn)
        for number, (text, parameters, more) in enumerate(_mixed(drawn)[:each], start=1):
            method = getattr(asker.truth, family.replace(" ", "_"))
            answer = more.pop("answer") if "answer" in more else method(**parameters)
            name = f"{facts.number}-{family.replace(' ', '-')}-{number}"
            found.append(
                HouseQuestion(name, facts.number, family, text, parameters, answer, **more)
            )
    return found


def _mixed(drawn: list[Drawn]) -> list[Drawn]:
    """The drawn ones, taking turns over what `mix` they belong to."""
    piles: dict[Any, list[Drawn]] = {}
    for one in drawn:
        piles.setdefault(one[2].pop("mix", None), []).append(one)
    turns = itertools.zip_longest(*(piles[key] for key in sorted(piles, key=str)))
    return [one for turn in turns for one in turn if one is not None]


class _Asker:
    """Everything that can be asked of a house, family by family."""

    def __init__(self, facts: HouseFacts) -> None:
        self._facts = facts
        self.truth = PlainMap(facts.now, facts.before)
        self._rooms = {room["label"]: room for room in facts.now["rooms"]}
        self._categories = sorted(OBJECTS)
        seen = Counter((one["category"], one["room"]) for one in self.truth.things)
        #: things that are the only one of their category in their room
        self._anchors = [
            one
            for one in self.truth.things
            if seen[one["category"], one["room"]] == 1
            and not self._in_doubt(one["category"], one["room"])
        ]
        self.families: Mapping[str, Callable[[], Iterator[Drawn]]] = {
            "count": self._count,
            "count in place": self._count_in_place,
            "presence": self._presence,
            "nearest": self._nearest,
            "within radius": self._within_radius,
            "between": self._between,
            "on or in": self._on_or_in,
            "last seen": self._last_seen,
            "moved since": self._moved_since,
            "never looked": self._never_looked,
            "past": self._past,
            "appeared since": self._appeared_since,
            "vanished since": self._vanished_since,
            "size": self._size,
            "why": self._why,
            "picture": self._picture,
            "unanswerable": self._unanswerable,
            "plan": self._plan,
        }

    def _count(self) -> Iterator[Drawn]:
        for category in self._categories:
            if not self._in_doubt(category):
                text = f"How many {_plural(category)} were seen in the house?"
                yield text, {"category": category}, {"mix": min(self.truth.count(category), 4)}

    def _count_in_place(self) -> Iterator[Drawn]:
        for category, room in self._pairs():
            many = self.truth.count_in_place(category, room)
            if many:
                text = f"How many {_plural(category)} were seen in the {room}?"
                yield text, {"category": category, "room": room}, {"mix": min(many, 3)}

    def _presence(self) -> Iterator[Drawn]:
        for category, room in self._pairs():
            there = self.truth.presence(category, room)
            if there or self._rooms[room]["viewed_share"] >= WHOLE + 0.03:
                text = f"Is there {_a(category)} in the {room}?"
                yield text, {"category": category, "room": room}, {"mix": there}

    def _nearest(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            for category in self._categories:
                away = sorted(
                    _distance(one, anchor)
                    for one in self.truth.things
                    if one["category"] == category and one is not anchor
                )
                if len(away) < 2 or away[1] - away[0] < NEAR or self._in_doubt(category):
                    continue
                text = f"Where is the {category} nearest to {_the(anchor)}?"
                parameters = {"category": category, **_anchored("to", anchor)}
                yield text, parameters, {"tolerance": NEAR}

    def _within_radius(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            text = f"What is within {RADIUS} m of {_the(anchor)}, over the floor?"

            def reached(one: Thing, margin: float, anchor: Thing = anchor) -> bool:
                return 0 < _distance(one, anchor) < RADIUS + margin

            ignored = self._ignored(reached)
            parameters = {"radius": RADIUS, **_anchored("of", anchor)}
            yield text, parameters, {"ignore": ignored}

    def _between(self) -> Iterator[Drawn]:
        for one, other in itertools.combinations(self._anchors, 2):
            if not 1.5 < _distance(one, other) < 5.0:
                continue

            def reached(
                thing: Thing, margin: float, ends: tuple[Thing, Thing] = (one, other)
            ) -> bool:
                return thing not in ends and on_strip(thing, *ends, margin=margin)

            parameters = _anchored("one", one) | _anchored("other", other)
            there = self.truth.between(**parameters)
            text = f"What is between {_the(one)} and {_the(other)}, on a strip 1 m wide?"
            ignored = self._ignored(reached)
            if set(there or ()) - set(ignored):
                yield text, parameters, {"ignore": ignored}

    def _on_or_in(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            parameters = _anchored("thing", anchor)
            there = self.truth.on_or_in(**parameters)
            if there or anchor["category"] in _CARRIERS:
                text = f"What is on or in {_the(anchor)}?"
                nearby = (d for d in self._facts.doubtful if _distance(_spot(d), anchor) < 1.0)
                ignored = _labels(nearby, there or ())
                yield text, parameters, {"ignore": ignored, "mix": bool(there)}

    def _last_seen(self) -> Iterator[Drawn]:
        departed = {one["category"] for one in self._facts.now["departed"]}
        for category in self._categories:
            known = self.truth.count(category) or category in departed
            if known and not self._in_doubt(category) and category not in self._facts.glimpsed:
                text = f"When was {_a(category)} last seen in the house?"
                left = not self.truth.count(category)
                yield text, {"category": category}, {"tolerance": SECONDS, "mix": left}

    def _moved_since(self) -> Iterator[Drawn]:
        for room in (None, *self._rooms):
            moved = self.truth.moved_since(room)
            if moved:
                ignored = _labels(self._facts.doubtful, moved)
                where = "in the house" if room is None else f"now in the {room}"
                text = f"What {where} stood elsewhere when the first drive ended?"
                yield text, {"room": room}, {"ignore": ignored}

    def _never_looked(self) -> Iterator[Drawn]:
        for category, room in self._pairs():
            share = self._rooms[room]["viewed_share"]
            status = self.truth.never_looked(category, room)
            clear = min(abs(share - NEVER), abs(share - WHOLE)) >= 0.03
            if status == "present" or clear:
                text = (
                    f"What is known of {_a(category)} in the {room}: is one present, gone (it was "
                    "there), looked, none seen (all was viewed), hidden (a part was not viewed), "
                    "or never looked?"
                )
                yield text, {"category": category, "room": room}, {"mix": status}

    def _why(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            text = f"Which frame shows {_the(anchor)}?"
            frames = [list(frame) for frame in self._facts.frames[anchor["name"]]]
            yield text, _anchored("thing", anchor), {"answer": frames}

    def _past(self) -> Iterator[Drawn]:
        for category, room in self._pairs():
            then, now = (
                method(category, room) for method in (self.truth.past, self.truth.count_in_place)
            )
            if then != now:
                text = (
                    f"How many {_plural(category)} were known in the {room} when the first drive "
                    "ended?"
                )
                yield text, {"category": category, "room": room}, {"mix": min(then, 2)}

    def _appeared_since(self) -> Iterator[Drawn]:
        yield from self._since(self.truth.appeared_since, "is known {} that was not known when")

    def _vanished_since(self) -> Iterator[Drawn]:
        yield from self._since(self.truth.vanished_since, "is gone {} that was known when")

    def _since(self, method: Callable[[str | None], list[str]], words: str) -> Iterator[Drawn]:
        for room in (None, *self._rooms):
            there = method(room)
            if there:
                where = "in the house" if room is None else f"in the {room}"
                text = f"What {words.format(where)} the first drive ended?"
                yield text, {"room": room}, {"ignore": _labels(self._facts.doubtful, there)}

    def _size(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            longest = self.truth.size(**_anchored("thing", anchor)) or 0.0
            text = f"How long is the longer side of {_the(anchor)} over the floor, along its walls?"
            if longest >= _LARGE:
                yield text, _anchored("thing", anchor), {"tolerance": round(0.15 * longest, 2)}

    def _picture(self) -> Iterator[Drawn]:
        for anchor in self._anchors:
            text = f"Which part of which frame is a picture of {_the(anchor)}?"
            boxes = self._facts.boxes.get(anchor["name"], ())
            answer = [[recording, frame, *box] for recording, frame, box in boxes]
            if answer:
                yield text, _anchored("thing", anchor), {"answer": answer}

    def _unanswerable(self) -> Iterator[Drawn]:
        for category, room in self._pairs():
            known = self.truth.unanswerable(category, room)
            share = self._rooms[room]["viewed_share"]
            if known != 0 and not NEVER - 0.03 < share < NEVER + 0.03:
                text = (
                    f"How many {_plural(category)} were seen in the {room}, or is that not known "
                    "since nobody looked there?"
                )
                yield text, {"category": category, "room": room}, {"mix": known == NOT_KNOWN}

    def _plan(self) -> Iterator[Drawn]:
        for category in sorted(MOVABLE):
            rooms = sorted(self._facts.rooms_with.get(category, ()))
            known = [one["room"] for one in self.truth.things if one["category"] == category]
            if len(rooms) == 1 and rooms == known and not self._in_doubt(category):
                text = f"Somebody wants {_a(category)}: which rooms to look in, in which order?"
                before = self.truth.past(category, rooms[0])
                yield text, {"category": category}, {"answer": rooms, "mix": bool(before)}

    def _pairs(self) -> Iterator[tuple[str, str]]:
        for category, room in itertools.product(self._categories, self._rooms):
            if not self._in_doubt(category, room):
                yield category, room

    def _in_doubt(self, category: str, room: str | None = None) -> bool:
        return any(
            category in one.labels and room in (None, self._room_of(one.x, one.y))
            for one in self._facts.doubtful
        )

    def _room_of(self, x: float, y: float) -> str | None:
        for label, room in self._rooms.items():
            (x0, y0), _, (x1, y1), _ = room["outline"][0]
            if x0 <= x < x1 and y0 <= y < y1:
                return str(label)
        return None

    def _ignored(self, reached: Callable[[Thing, float], bool]) -> list[str]:
        """Categories of things near the border of what is `reached`, and of doubtful ones there.

        Not those of which there is one surely within.
        """
        sure = {one["category"] for one in self.truth.things if reached(one, -BORDER)}
        about = {one["category"] for one in self.truth.things if reached(one, BORDER)}
        doubtful = (one for one in self._facts.doubtful if reached(_spot(one), BORDER))
        return sorted({*about, *_labels(doubtful, ())} - sure)


_LARGE: Final = 0.5  # [m] side of a thing whose size is asked for
_CARRIERS: Final = ("bed", "bench", "chair", "couch", "dining table", "refrigerator")


def _distance(one: Thing, other: Thing) -> float:
    (x0, y0), (x1, y1) = one["position"][:2], other["position"][:2]
    return float(((x1 - x0) ** 2 + (y1 - y0) ** 2) ** 0.5)


def _spot(one: Doubtful) -> Thing:
    return {"position": [one.x, one.y]}


def _labels(doubtful: Iterable[Doubtful], known: Iterable[str]) -> list[str]:
    """Labels of doubtful things without those that are known to be right."""
    return sorted({label for one in doubtful for label in one.labels} - set(known))


def _anchored(name: str, thing: Thing) -> dict[str, Any]:
    return {name: thing["category"], f"{name}_room": thing["room"]}


def _the(thing: Thing) -> str:
    return f"the {thing['category']} in the {thing['room']}"


def _a(category: str) -> str:
    return f"{'an' if category[0] in 'aeiou' else 'a'} {category}"


def _plural(category: str) -> str:
    if category in _PLURALS:
        return _PLURALS[category]
    return category + ("es" if category.endswith(("ch", "sh", "s", "x")) else "s")
