"""The stage on which a script of `correction_scripts` is played: people, a camera and networks."""

from collections.abc import Callable, Iterator

import numpy as np

from kg.knowledge.ontology.lint import check_map
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Rectangle
from mapping.mapper import Mapper
from mapping.mapping_options import MappingOptions
from mapping.places.layout import Layout, LayoutPlace
from perception.frames import Detections, Frame, SceneScores
from tests.mapping.correction_scripts import Script

BASE = "https://example.org/map/"
BOXES = {"": (30, 22, 34, 26), "left": (4, 22, 8, 26), "right": (56, 22, 60, 26)}
ROOM = Layout((LayoutPlace(1, "the room", Rectangle(0.0, 6.0, -4.0, 4.0)),))


class Acts:
    """What people do, by the words of a script."""

    def __init__(self, semantic_map: SemanticMap) -> None:
        self.map = semantic_map

    def do(self, verb: str, words: list[str]) -> None:
        getattr(self, f"_{verb}")(*words)

    def _say(self, thing: str, prop: str, *value: str) -> None:
        assert self.map.assertions.add(thing, prop, " ".join(value), by="ann") is not None

    def _unsay(self, thing: str, prop: str) -> None:
        assert self.map.assertions.retract(thing, prop, by="ann") is not None

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
    """A camera and networks that follow a script, and people who act between two frames."""

    def __init__(self, steps: list[str], acts: Acts, frame: Callable[..., Frame]) -> None:
        self.steps, self.acts, self.make_frame = steps, acts, frame

    def shots(self) -> Iterator[tuple[Frame, Detections, SceneScores]]:
        """Each frame with what the networks say of it, once the acts before it are done."""
        for number, step in enumerate(self.steps, start=1):
            verb, *words = step.split()
            if verb not in ("see", "look", "blind", "view"):
                self.acts.do(verb, words)
                continue
            depth = {"look": 5.0, "blind": 1.0, "view": 1.0}.get(verb, self._depth(words))
            T = self.make_frame().T_map_cam.copy()
            T[2, 3] += 0.2 * number * (verb == "view")  # a pose is used for one view only
            frame = self.make_frame(depth, T=T, id=step, stamp=1000.0 + number)
            scores = SceneScores({words[0]: 1.0} if verb == "view" else {})
            yield frame, self._detections(verb, words), scores

    def _detections(self, verb: str, words: list[str]) -> Detections:
        if verb != "see":
            return Detections(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), ())
        side = next((word for word in words[1:] if word in BOXES), "")
        box = np.array([BOXES[side]], dtype=np.float32)
        return Detections(box, np.ones(1, np.float32), (words[0],))

    def _depth(self, words: list[str]) -> float:
        return next((float(word) for word in words if word[0].isdigit()), 2.0)


def runs(steps: str) -> Iterator[list[str]]:
    for part in steps.split("restart"):
        yield [step.strip() for step in part.split(";") if step.strip()]


def halves(steps: list[str]) -> tuple[list[str], list[str]]:
    return steps[: len(steps) // 2], steps[len(steps) // 2 :]


def play(semantic_map, steps, frame, people=None):
    name = f"run {len(semantic_map.recordings())}"
    given = {"recording": name, "detector": name, "scene_model": name}
    with Mapper(semantic_map, MappingOptions(mode="reference", layout=ROOM), **given) as mapper:
        for shot in Stage(steps, Acts(people or semantic_map), frame).shots():
            mapper.add(*shot)


def as_told(semantic_map: SemanticMap, script: Script) -> None:
    catalogue = semantic_map.catalogue
    told = [
        f"{o.iri.rpartition('/')[2]} {catalogue.label(o.category)} "
        f"{o.p_map[0]:g} {o.p_map[1]:g}{'' if o.existence > 0 else '!'}"
        for o in semantic_map.objects()
    ]
    assert ", ".join(told) == script.objects
    (place,) = semantic_map.query("places").records()
    assert place["category"] == script.place
    conflicts = [
        f"{c.subject.removeprefix(BASE)} {c.property}" for c in semantic_map.assertions.conflicts()
    ]
    assert ", ".join(conflicts) == script.conflicts
    assert len(semantic_map.query("conflicts").rows) == len(conflicts)
    inside = {o.iri for o in semantic_map.objects() if abs(o.p_map[1]) <= 4}
    assert {o.iri for o in semantic_map.objects() if o.place is not None} == inside
    assert check_map(semantic_map.engine) == []
