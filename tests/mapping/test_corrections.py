"""Fifty ways in which people and perception agree, contradict each other and change their minds.

One camera looks along x. A script is steps separated by ``;``:

    see LABEL [left|right] [D]   the detector finds one at depth D [m], 2 unless said
    look                         nothing is detected, though all the room is visible
    blind                        nothing is detected, and all is hidden
    view CATEGORY                the scene network is sure of a category
    say THING PROPERTY VALUE     somebody asserts; ``unsay THING PROPERTY`` retracts
    delete THING, move N X Y, retype THING CATEGORY, add N CATEGORY X Y,
    rethink CATEGORY BELIEF VIEWS
                                 the same by SPARQL Update
    restart                      the run ends and another begins

and after it the map must be as told: objects as ``N CATEGORY X Y``, with ``!`` behind those that
are believed gone; the place's category; and what is in conflict.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from kg.check import check_map
from kg.commits import Cause
from kg.records import MapUpdate, PlaceRecord
from kg.semantic_map import SemanticMap
from mapping.layout import Layout, Rectangle
from mapping.object_mapper import ObjectMapper
from mapping.pipeline import map_recording
from mapping.place_book import PlaceBook
from mapping.settings import ReferenceSettings
from perception.frame import Detections, Frame, SceneScores

BASE = "https://example.org/map/"
BOXES = {"": (30, 22, 34, 26), "left": (4, 22, 8, 26), "right": (56, 22, 60, 26)}
ROOM = Layout((Rectangle(1, "the room", 0.0, 6.0, -4.0, 4.0),))


class Script(NamedTuple):
    name: str
    steps: str
    objects: str = ""
    place: str | None = None
    conflicts: str = ""


SCRIPTS = (
    # without people
    Script("a cup is seen", "see cup", "1 cup 2 0"),
    Script("a cup is seen, then missed twice", "see cup; look; look"),
    Script("a cup outlives a restart", "see cup; restart; see cup", "1 cup 2 0"),
    Script("two cups apart", "see cup left; see cup right", "1 cup 2 1.04, 2 cup 2 -1.04"),
    # deleted by hand
    Script("deleted, it stays deleted", "see cup; delete object/1; blind; blind"),
    Script("deleted, it is not brought back by looking", "see cup; delete object/1; look; look"),
    Script("deleted and seen again, it is new", "see cup; delete object/1; see cup", "2 cup 2 0"),
    Script("deleted over a restart", "see cup; delete object/1; restart; blind"),
    Script(
        "deleted twice, seen thrice",
        "see cup; delete object/1; see cup; delete object/2; see cup",
        "3 cup 2 0",
    ),
    Script(
        "deleting one leaves the other",
        "see cup left; see cup right; delete object/1; blind",
        "2 cup 2 -1.04",
    ),
    Script(
        "deleted with all that was said of it",
        "see cup; say object/1 category bowl; delete object/1; see cup",
        "2 cup 2 0",
    ),
    # moved by hand
    Script("moved, it stays where it was put", "see cup; move 1 3 0; blind", "1 cup 3 0"),
    Script("moved, it is found where it was put", "see cup; move 1 3 0; see cup 3", "1 cup 3 0"),
    Script(
        "moved, the old spot is another cup's",
        "see cup; move 1 3 0; see cup 2",
        "1 cup 3 0, 2 cup 2 0",
    ),
    Script("moved over a restart", "see cup; move 1 3 0; restart; see cup 3", "1 cup 3 0"),
    Script("moved a little, the mean goes on", "see cup; move 1 2.4 0; see cup", "1 cup 2.2 0"),
    # added by hand
    Script("added, it is there", "blind; add 7 cup 2 0; blind", "7 cup 2 0"),
    Script("added, it is the one that is seen", "add 7 cup 2 0; see cup", "7 cup 2 0"),
    Script("added numbers are not used again", "add 7 cup 3 2; see cup", "7 cup 3 2, 8 cup 2 0"),
    Script("added, it fades when missed", "add 7 cup 2 0; look; look; look"),
    Script("added over a restart", "add 7 cup 2 0; restart; see cup", "7 cup 2 0"),
    # an object's category
    Script(
        "corrected, it sticks",
        "see cup; say object/1 category bowl; see cup; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected, both names are its own",
        "see cup; say object/1 category bowl; see bowl; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected by an update, it sticks",
        "see cup; retype object/1 bowl; see cup; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected over a restart",
        "see cup; say object/1 category bowl; restart; see cup",
        "1 bowl 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected and taken back",
        "see cup; say object/1 category bowl; see cup; unsay object/1 category",
        "1 cup 2 0",
    ),
    Script(
        "an update taken back",
        "see cup; retype object/1 bowl; see cup; unsay object/1 category; see cup",
        "1 cup 2 0",
    ),
    Script(
        "corrected twice, the last counts",
        "see cup; say object/1 category bowl; say object/1 category vase; see cup",
        "1 vase 2 0",
        conflicts="object/1 category",
    ),
    Script(
        "corrected twice, taken back once: perception's own",
        "see cup; say object/1 category bowl; retype object/1 vase; unsay object/1 category",
        "1 cup 2 0",
    ),
    Script(
        "confirmed, there is no conflict",
        "see cup; say object/1 category cup; see cup",
        "1 cup 2 0",
    ),
    Script(
        "corrected, it still leaves when it is gone",
        "see cup; say object/1 category bowl; look; look",
    ),
    Script(
        "taken back, other names are others again",
        "see cup; say object/1 category bowl; unsay object/1 category; see bowl",
        "1 cup 2 0, 2 bowl 2 0",
    ),
    # an object's position
    Script(
        "put elsewhere, it sticks",
        "see cup; say object/1 position 4 2 0; see cup",
        "1 cup 4 2",
        conflicts="object/1 position",
    ),
    Script(
        "put elsewhere, what is seen there is it",
        "see cup; say object/1 position 3 0 1; see cup 3",
        "1 cup 3 0",
    ),
    Script(
        "put elsewhere and taken back: perception's mean, kept up",
        "see cup; say object/1 position 4 2 0; see cup 2.4; unsay object/1 position",
        "1 cup 2.2 0",
    ),
    Script(
        "put elsewhere, it is not missed where it was",
        "see cup; say object/1 position 4 9 0; look; look; look",
        "1 cup 4 9",
        conflicts="object/1 position",
    ),
    Script(
        "put elsewhere, then moved by an update",
        "see cup; say object/1 position 4 2 0; move 1 3 2; see cup",
        "1 cup 3 2",
        conflicts="object/1 position",
    ),
    Script(
        "put elsewhere over a restart, taken back",
        "see cup; say object/1 position 4 2 0; restart; see cup 2.4; unsay object/1 position",
        "1 cup 2.2 0",
    ),
    # whether it is there
    Script(
        "said to be absent, it is believed gone though seen",
        "see cup; say object/1 existence absent; see cup",
        "1 cup 2 0!",
        conflicts="object/1 existence",
    ),
    Script(
        "said to be absent, taken back",
        "see cup; say object/1 existence absent; see cup; unsay object/1 existence",
        "1 cup 2 0",
    ),
    Script(
        "said to be absent, and perception agrees",
        "see cup; say object/1 existence absent; look; look",
    ),
    Script(
        "said to be present, it stays though missed",
        "see cup; say object/1 existence present; look; look; look",
        "1 cup 2 0",
        conflicts="object/1 existence",
    ),
    Script(
        "said to be present, taken back after it was missed",
        "see cup; say object/1 existence present; look; look; look; unsay object/1 existence",
    ),
    Script(
        "said to be present, missed, and seen again",
        "see cup; say object/1 existence present; look; look; see cup",
        "1 cup 2 0",
    ),
    Script(
        "said to be present over a restart",
        "see cup; say object/1 existence present; look; restart; look; look",
        "1 cup 2 0",
        conflicts="object/1 existence",
    ),
    # what kind of place it is
    Script("a kitchen is viewed", "view kitchen", place="kitchen"),
    Script(
        "an asserted place sticks",
        "view kitchen; say place/1 category bedroom; view kitchen",
        place="bedroom",
        conflicts="place/1 category",
    ),
    Script(
        "a place never viewed is what is said",
        "blind; say place/1 category bedroom",
        place="bedroom",
    ),
    Script(
        "a place written by an update sticks",
        "view kitchen; retype place/1 bedroom; view kitchen; view kitchen",
        place="bedroom",
        conflicts="place/1 category",
    ),
    Script(
        "a place taken back is what was viewed meanwhile",
        "view kitchen; say place/1 category bedroom; view attic; view attic; "
        "unsay place/1 category",
        place="attic",
    ),
    Script(
        "a place taken back goes on from its views",
        "view kitchen; say place/1 category bedroom; view kitchen; unsay place/1 category; "
        "view attic",
        place="kitchen",
    ),
    Script(
        "a place over a restart",
        "view kitchen; say place/1 category bedroom; restart; view kitchen",
        place="bedroom",
        conflicts="place/1 category",
    ),
    Script(
        "perception comes to agree about a place",
        "view kitchen; say place/1 category attic; view attic; view attic",
        place="attic",
    ),
    Script(
        "a belief edited by hand is what the next view goes on from",
        "view kitchen; view kitchen; view kitchen; rethink kitchen 0.2 1; view attic",
        place="attic",
    ),
    # all at once
    Script(
        "corrected and put elsewhere, it is known by both names at both spots",
        "see cup; say object/1 category bowl; say object/1 position 4 2 0; see bowl; see cup",
        "1 bowl 4 2",
        conflicts="object/1 category, object/1 position",
    ),
    Script(
        "corrected, put elsewhere, all taken back",
        "see cup; say object/1 category bowl; say object/1 position 4 2 0; see cup; "
        "unsay object/1 category; unsay object/1 position; see cup",
        "1 cup 2 0",
    ),
    Script(
        "one is deleted while another is corrected",
        "see cup left; see cup right; say object/2 category bowl; delete object/1; see cup left",
        "2 bowl 2 -1.04, 3 cup 2 1.04",
        conflicts="object/2 category",
    ),
    Script(
        "a place and its cup",
        "see cup; view kitchen; say place/1 category bedroom; say object/1 category bowl; see cup; "
        "unsay place/1 category",
        "1 bowl 2 0",
        place="kitchen",
        conflicts="object/1 category",
    ),
)


class Acts:
    """What people do, by the words of a script."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self.map = semantic_map

    def do(self, verb: str, words: list[str]) -> None:
        getattr(self, f"_{verb}")(*words)

    def _say(self, thing: str, prop: str, *value: str) -> None:
        assert self.map.assert_(thing, prop, " ".join(value), by="ann") is not None

    def _unsay(self, thing: str, prop: str) -> None:
        assert self.map.retract(thing, prop, by="ann") is not None

    def _delete(self, thing: str) -> None:
        self._update(f"DELETE WHERE {{ <{BASE}{thing}> ?p ?o }}")

    def _move(self, number: str, x: str, y: str) -> None:
        self._update(
            f"DELETE {{ ?o here:x ?x . ?o here:y ?y }} INSERT {{ ?o here:x {x} . ?o here:y {y} }} "
            f"WHERE {{ VALUES ?o {{ <{BASE}object/{number}> }} ?o here:x ?x . ?o here:y ?y }}"
        )

    def _retype(self, thing: str, category: str) -> None:
        self._update(f"INSERT DATA {{ <{BASE}{thing}> a <{self._class(category)}> }}")

    def _add(self, number: str, category: str, x: str, y: str) -> None:
        kind = self._class(category)
        thing = f"<{BASE}object/{number}>"
        self._update(f"INSERT DATA {{ {thing} a <{kind}> ; here:x {x} ; here:y {y} ; here:z 1 }}")

    def _rethink(self, category: str, belief: str, views: str) -> None:
        held = f"<{BASE}place/1/belief/{self._class(category).rpartition('#')[2]}>"
        self._update(
            f"DELETE {{ {held} here:belief ?b . ?p here:viewCount ?n }} "
            f"INSERT {{ {held} here:belief {belief}e0 . ?p here:viewCount {views} }} "
            f"WHERE {{ {held} here:belief ?b . ?p here:viewCount ?n }}"
        )

    def _class(self, category: str) -> str:
        return self.map.catalogue.find(category).iri

    def _update(self, sparql: str) -> None:
        assert self.map.update(sparql, by="ann") is not None


class Stage:
    """A recording, a detector and a scene network that follow a script, and people meanwhile."""

    name = "scripted"
    T_map_world = np.eye(4)

    def __init__(self, steps: list[str], acts: Acts, frame: Callable[..., Frame], run: int) -> None:
        self.steps, self.acts, self.make_frame = steps, acts, frame
        self.name = f"run {run}"
        self.shown: list[str] = []

    def __len__(self) -> int:
        return 1000  # whatever it will be

    def frames(self, start: int = 0) -> Iterator[Frame]:
        for number, step in enumerate(self.steps, start=1):
            verb, *words = step.split()
            if verb not in ("see", "look", "blind", "view"):
                self.acts.do(verb, words)
                continue
            self.shown = [verb, *words]
            depth = {"look": 5.0, "blind": 1.0, "view": 1.0}.get(verb, self._depth(words))
            T = self.make_frame().T_map_cam.copy()
            T[2, 3] += 0.2 * number * (verb == "view")  # a pose is used for one view only
            yield self.make_frame(depth, T=T, id=step, stamp=1000.0 + number)

    def detect(self, frame: Frame) -> Detections:
        if self.shown[0] != "see":
            return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
        side = next((word for word in self.shown[2:] if word in BOXES), "")
        box = np.array([BOXES[side]], dtype=np.float32)
        return Detections(box, np.ones(1, np.float32), (self.shown[1],))

    def classify(self, frame: Frame) -> SceneScores:
        return SceneScores({self.shown[1]: 1.0} if self.shown[0] == "view" else {})

    def _depth(self, words: list[str]) -> float:
        return next((float(word) for word in words if word[0].isdigit()), 2.0)


def runs(steps: str) -> Iterator[list[str]]:
    for part in steps.split("restart"):
        yield [step.strip() for step in part.split(";") if step.strip()]


def halves(steps: list[str]) -> tuple[list[str], list[str]]:
    return steps[: len(steps) // 2], steps[len(steps) // 2 :]


def play(
    semantic_map: SemanticMap,
    steps: list[str],
    frame: Callable[..., Frame],
    people: SemanticMap | None = None,
) -> None:
    run = len(semantic_map.recordings())
    stage = Stage(steps, Acts(people or semantic_map), frame, run)
    map_recording(stage, semantic_map, stage, stage, layout=ROOM)


def as_told(semantic_map: SemanticMap, script: Script) -> None:
    catalogue = semantic_map.catalogue
    told = [
        f"{o.iri.rpartition('/')[2]} {catalogue.label(o.category)} "
        f"{o.p_map[0]:g} {o.p_map[1]:g}{'' if o.existence > 0 else '!'}"
        for o in semantic_map.objects()
    ]
    assert ", ".join(told) == script.objects
    (place,) = semantic_map.ask("places").records()
    assert place["category"] == script.place
    conflicts = [f"{c.subject.removeprefix(BASE)} {c.property}" for c in semantic_map.conflicts()]
    assert ", ".join(conflicts) == script.conflicts
    assert len(semantic_map.ask("conflicts").rows) == len(conflicts)
    inside = {o.iri for o in semantic_map.objects() if abs(o.p_map[1]) <= 4}
    assert {o.iri for o in semantic_map.objects() if o.place is not None} == inside
    assert check_map(semantic_map.engine) == []


@pytest.fixture(scope="module")
def empty_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "empty.map"
    SemanticMap.create(path, base=BASE).close()
    return path


def test_there_are_fifty_scripts_and_no_two_are_the_same():
    assert len({script.steps for script in SCRIPTS}) == len(SCRIPTS) >= 50


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_map_is_as_told(script, make_frame):
    with SemanticMap.in_memory(base=BASE) as semantic_map:
        for steps in runs(script.steps):
            play(semantic_map, steps, make_frame)
        as_told(semantic_map, script)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_the_map_is_as_told_when_reopened_again_and_again(script, make_frame, empty_map, tmp_path):
    path = tmp_path / "a.map"
    shutil.copytree(empty_map, path)
    parts = [part for steps in runs(script.steps) for part in halves(steps)]
    for number, part in enumerate(parts, start=1):
        with SemanticMap.open(path) as semantic_map:
            play(semantic_map, part, make_frame)
            if number == len(parts):
                as_told(semantic_map, script)


def said(script: Script) -> bool:
    """Whether people only say and unsay: updates are for maps in a folder."""
    verbs = {step.split()[0] for steps in runs(script.steps) for step in steps}
    return "say" in verbs and verbs <= {"see", "look", "blind", "view", "say", "unsay"}


@pytest.mark.parametrize("script", [*filter(said, SCRIPTS)][::3], ids=lambda script: script.name)
def test_people_and_mapper_are_two_programs_on_one_server(
    script: Script, sparql_server: str, make_frame: Callable[..., Frame]
) -> None:
    with (
        SemanticMap.create(sparql_server, base=BASE) as semantic_map,
        SemanticMap.open(sparql_server) as people,
    ):
        for steps in runs(script.steps):
            play(semantic_map, steps, make_frame, people)
        as_told(semantic_map, script)


def test_the_mapper_hears_of_what_another_program_moves_removes_and_adds(
    sparql_server: str, make_frame: Callable[..., Frame]
) -> None:
    with (
        SemanticMap.create(sparql_server, base=BASE) as semantic_map,
        SemanticMap.open(sparql_server) as other,
    ):
        mapper = ObjectMapper(semantic_map, ReferenceSettings())
        book = PlaceBook(semantic_map, ROOM)
        stage = Stage(["see cup left", "see cup right"], Acts(other), make_frame, 0)
        for frame in stage.frames():
            changes = mapper.step(frame, stage.detect(frame))
            semantic_map.apply(MapUpdate(objects=changes.updated))
        left, right = other.objects()
        mapper.refresh()
        assert {o.iri for o in mapper.objects()} == {left.iri, right.iri}
        kitchen = other.catalogue.find("kitchen").iri
        added = replace(left, iri=f"{BASE}object/9", p_map=np.array([5.0, 3.0, 1.0]))
        moved = replace(right, p_map=np.array([3.0, 2.0, 1.0]))
        update = MapUpdate(
            objects=(added, moved),
            removed=(left.iri,),
            places=(PlaceRecord(f"{BASE}place/7", "loft", 10, 12, 0, 2, 1, {kitchen: 1.0}),),
        )
        other.apply(update, Cause("import", "somebody"))
        mapper.refresh()
        book.refresh()
        found = {o.iri: tuple(o.p_map) for o in mapper.objects()}
        assert found == {moved.iri: (3.0, 2.0, 1.0), added.iri: (5.0, 3.0, 1.0)}
        assert [p.label for p in book.places()] == ["the room", "loft"]
