"""The demo: a simulated robot maps a house it has never seen, answers questions, finds an apple.

Only the robot's body and senses are simulated (`planner.simulation`). The mapper, the graph on
disk, the queries, the search goals, the plan, the export and the picture are the real ones.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hereabouts.demo.demo_search import DemoPlan, DrivenSearch, carry_out, plan_for
from hereabouts.display.plots.drawing import GroundTruth
from hereabouts.display.plots.search_plot import plot_search
from kg.export.serialization import export_map
from kg.history.reports.comparison import PRESENT
from kg.maps.query.evaluation import Table
from kg.maps.semantic_map import SemanticMap
from kg.model.areas import Rectangle
from kg.model.errors import GraphError, MapBusyError
from kg.model.platforms import most_memory
from kg.serving.opening import create_map, open_map
from mapping.mapping_options import MappingOptions
from mapping.places.layout import Layout, LayoutPlace
from mapping.recording_mapper import map_recording
from mapping.reference.class_scores import MapScore, Truth, score_map
from mapping.runs.progress_report import FrameReport, MappingReport
from planner.execution.options import Event
from planner.search.plans.report import plan_json
from planner.simulation.camera import SimulatedCamera
from planner.simulation.house import House, Item, furnished_house
from planner.simulation.house_robot import (
    DEMO_RECORDING,
    SimulatedHouseRobot,
    SimulatedTour,
    simulated_robot,
)
from planner.simulation.sensors import SimulatedDetector, SimulatedSceneClassifier

TITLE: Final = "hereabouts demo house"
TARGET: Final = "apple"
#: An object that is brought into the house after the tour.
HIDDEN: Final = Item(TARGET, 7.10, 8.00, 0.85)
SEARCH_TIME: Final = 120.0  # [s] from the end of the drive to now, for the search
#: Kinds and authors of the transactions of a demo, and the files of its map.
_OWN_CAUSES: Final = (("frame", None), ("search", "search/1"))
_OWN_FILES: Final = frozenset(
    (
        *("store", "lock", "pictures", "detections.json"),
        *("history.sqlite", "surface.sqlite", "tracks.sqlite", "views.sqlite"),
    )
)
STAGES: Final = ("map", "ask", "plan", "search", "export", "picture")


@dataclass(frozen=True, slots=True)
class DemoProgress:
    """The progress of the demo."""

    stage: str  # one of STAGES
    done: int  # steps of this stage
    total: int
    note: str = ""  # detail of the step


@dataclass(frozen=True, slots=True)
class DemoAnswer:
    """One question of the demo, its query as for `hereabouts ask`, and the answer."""

    question: str
    query: str  # name of the shipped query
    parameters: Mapping[str, str | float]
    table: Table


@dataclass(frozen=True, slots=True)
class DemoReport:
    """Report of the demo."""

    map_path: Path
    export_path: Path
    picture_path: Path
    mapping: MappingReport
    score: MapScore  # of the map against the house
    searched: MapScore  # the same after the search, against the house with the hidden object
    rooms_right: int  # places whose most probable category is that of their room
    rooms: int
    answers: tuple[DemoAnswer, ...]
    planned: DemoPlan
    search: DrivenSearch
    hidden_in: str  # category of the room the target truly is in
    position_error: float | None  # [m] of the found target, None where it was not found
    triples: int  # exported
    seconds: float  # [s] wall clock of the whole demo
    peak_memory: float  # [MB] of this process

    def to_json(self) -> dict[str, Any]:
        """Plain values, for `--json`."""
        return {
            "map": str(self.map_path),
            "export": str(self.export_path),
            "picture": str(self.picture_path),
            "mapping": self.mapping.to_json(),
            "score": self.score.to_json(),
            "score_after_search": self.searched.to_json(),
            "rooms": self.rooms,
            "rooms_right": self.rooms_right,
            "answers": [
                {
                    "question": a.question,
                    "query": a.query,
                    "parameters": dict(a.parameters),
                    "rows": [{k: _plain(v) for k, v in row.items()} for row in a.table.records()],
                }
                for a in self.answers
            ],
            "plan": plan_json(self.planned.plan),
            "search": {**self.search.to_json(), "position_error": self.position_error},
            "triples": self.triples,
            "seconds": round(self.seconds, 2),
            "peak_memory_mb": round(self.peak_memory, 1),
        }


OnProgress = Callable[[DemoProgress], None]


def run_demo(
    folder: Path | str,
    on_progress: OnProgress | None = None,
    *,
    seed: int = 0,
    replace: bool = False,
) -> DemoReport:
    """Map the house into `folder`/demo.map, query the map, search the house, and write the results.

    The results are map.ttl and map.png. Files of an earlier demo are replaced, those that something
    was added to only when told to `replace`, and other files never (`make_room`). `seed` is that of
    the errors of the senses. The drive ends some minutes before now, so that answers about the map
    are those of a robot at work. Raises GraphError or PictureError where `folder` cannot be
    written.
    """
    began = time.perf_counter()
    report = on_progress or (lambda progress: None)
    folder = Path(folder)
    map_path = folder / "demo.map"
    make_room(folder, replace=replace)
    house = furnished_house()
    camera = SimulatedCamera(house, seed=seed)
    tour = SimulatedTour(camera, name=DEMO_RECORDING, end=round(time.time() - SEARCH_TIME))
    with create_map(map_path, title=TITLE) as semantic_map:
        mapping = _map(semantic_map, tour, camera, report)
        answers = _ask(semantic_map, report)
        score, right = score_house(semantic_map, house), _rooms_right(semantic_map, house)
        changed = house.with_objects([HIDDEN])
        robot = simulated_robot(semantic_map, changed, seed=seed)
        report(DemoProgress("plan", 0, 1, TARGET))
        planned = plan_for(semantic_map, TARGET, robot)
        run = _search(semantic_map, robot, len(planned.plan.steps), report)
        searched = score_house(semantic_map, changed)
        report(DemoProgress("export", 0, 1))
        triples = export_map(semantic_map, folder / "map.ttl")
        report(DemoProgress("picture", 0, 1))
        ended = _ended(semantic_map)
        picture = plot_search(
            semantic_map,
            run.outcome.search,
            folder / "map.png",
            driven=run.driven,
            title=f"Demo house: the search for an {TARGET}",
            truth=ground_truth(house),
        )
    for path in (folder / "map.ttl", picture):
        os.utime(path, ns=(ended, ended))  # so that later changes of them are seen
    report(DemoProgress("picture", 1, 1, str(picture)))
    room, p_found = house.room_at(HIDDEN.x, HIDDEN.y), run.p_found
    error = None if p_found is None else float(np.linalg.norm(p_found - HIDDEN.centre()))
    return DemoReport(
        map_path=map_path,
        export_path=folder / "map.ttl",
        picture_path=picture,
        mapping=mapping,
        score=score,
        searched=searched,
        rooms_right=right,
        rooms=len(house.rooms),
        answers=answers,
        planned=planned,
        search=run,
        hidden_in=room.category if room else "outside",
        position_error=error,
        triples=triples,
        seconds=time.perf_counter() - began,
        peak_memory=most_memory(),
    )


def make_room(folder: Path, *, replace: bool = False) -> None:
    """Remove the map of an earlier demo from `folder`, and let its map.ttl and map.png be replaced.

    Raises GraphError, and removes nothing, where demo.map was not made by the demo; and, unless
    told to `replace`, where anything was added to a map or a file since a demo made it. Raises
    MapBusyError where another process has the map open.
    """
    map_path, remedy = folder / "demo.map", "another folder (--folder) would work"
    outputs = [path for path in (folder / "map.ttl", folder / "map.png") if os.path.lexists(path)]
    if os.path.lexists(map_path):
        found = _added_to_demo(map_path)
        if found is None:
            raise GraphError(f"{map_path} was not made by the demo, so it stays; {remedy}")
        added, ended = found
        changed = [str(path) for path in outputs if path.lstat().st_mtime_ns != ended]
        if (added or changed) and not replace:
            kept = f"{map_path} holds {added}" if added else f"{changed[0]} was changed"
            raise GraphError(
                f"{kept} since the demo made it, so it stays; {remedy}, and --replace removes it"
            )
        shutil.rmtree(map_path)
    elif outputs and not replace:
        raise GraphError(
            f"{outputs[0]} lies there without the demo's demo.map, so it stays; {remedy}, and "
            "--replace writes over it"
        )


def _ended(semantic_map: SemanticMap) -> int:
    """[ns] The time of the last transaction, to the millisecond."""
    return round(semantic_map.history.log.last_time * 1000) * 1_000_000


def _added_to_demo(map_path: Path) -> tuple[str, int] | None:
    """The content of a map that the demo did not write, or "", and the end of the demo [ns].

    None where it is no demo's map.
    """
    if map_path.is_symlink():
        return None
    try:
        with open_map(map_path, exclusive=True) as old:
            if old.description.title != TITLE:
                return None
            log = old.history.log
            causes = (commit.cause for commit in log.commits(0, log.last))
            others = [c for c in causes if (c.kind, c.by) not in _OWN_CAUSES]
            ended = _ended(old)
            recordings = {r.name for r in old.recordings()} - {DEMO_RECORDING}
    except MapBusyError:
        raise
    except GraphError:
        return None
    if others:
        return f"changes by {others[0].by or 'others'} ({others[0].kind})", ended
    if log.floor:
        return "a compacted history", ended
    foreign = {path.name for path in map_path.iterdir()} - _OWN_FILES
    return ", ".join(sorted(recordings | foreign)), ended


def layout_of(house: House) -> Layout:
    """The rooms as places without categories; the demo has to recognise these."""
    return Layout(
        tuple(
            LayoutPlace(
                number,
                f"place {number}",
                Rectangle(room.xmin, room.xmax, room.ymin, room.ymax),
            )
            for number, room in enumerate(house.rooms, start=1)
        )
    )


def score_house(semantic_map: SemanticMap, house: House) -> MapScore:
    """Scores of the map's objects against the objects in the house."""
    label = semantic_map.catalogue.label
    truth = Truth(
        names=tuple(f"{item.label} {number}" for number, item in enumerate(house.objects)),
        labels=tuple(item.label for item in house.objects),
        p_world=np.array([item.centre() for item in house.objects]),
        complete_for=tuple(
            c.label for c in semantic_map.catalogue.categories if c.kind == "object"
        ),
    )
    objects = [
        (label(record.category), record.p_map)
        for record in semantic_map.objects()
        if record.existence >= PRESENT
    ]
    return score_map(objects, truth, np.eye(4))


def _map(
    semantic_map: SemanticMap, tour: SimulatedTour, camera: SimulatedCamera, report: OnProgress
) -> MappingReport:
    places = [c.label for c in semantic_map.catalogue.categories if c.kind == "place"]

    def receive(frame: FrameReport) -> None:
        report(DemoProgress("map", frame.index + 1, frame.total, f"{frame.objects} objects"))

    return map_recording(
        tour,
        semantic_map,
        SimulatedDetector(camera),
        SimulatedSceneClassifier(camera, places),
        options=MappingOptions(layout=layout_of(camera.house)),
        on_frame=receive,
    )


def _ask(semantic_map: SemanticMap, report: OnProgress) -> tuple[DemoAnswer, ...]:
    """Three questions; the third builds on the answer to the second."""
    answers: list[DemoAnswer] = []

    def ask(question: str, query: str, **parameters: Any) -> Table:
        report(DemoProgress("ask", len(answers), 3, question))
        answers.append(
            DemoAnswer(question, query, parameters, semantic_map.query(query, **parameters))
        )
        return answers[-1].table

    ask("Is there anything to eat?", "objects-by-category", category="food")
    beliefs = ask("Which rooms are what?", "places-above-belief", threshold=0.3).records()
    kitchens = [str(row["label"]) for row in beliefs if row["category"] == "kitchen"]
    if kitchens:
        ask("What is in the kitchen?", "objects-in-place", place=kitchens[0])
    return tuple(answers)


def _search(
    semantic_map: SemanticMap, robot: SimulatedHouseRobot, planned: int, report: OnProgress
) -> DrivenSearch:
    looks = 0

    def receive(event: Event) -> None:
        nonlocal looks
        looks += event.kind == "look"
        report(DemoProgress("search", looks, max(looks, planned), event.kind))

    return carry_out(semantic_map, TARGET, robot, receive)


def _rooms_right(semantic_map: SemanticMap, house: House) -> int:
    believed = semantic_map.query("places").records()
    top = {str(row["label"]): row["category"] for row in believed}
    return sum(
        top.get(f"place {number}") == room.category
        for number, room in enumerate(house.rooms, start=1)
    )


def _plain(value: object) -> object:
    return value if value is None or isinstance(value, str | int | float | bool) else str(value)


def ground_truth(house: House) -> GroundTruth:
    """Walls, boxes around furniture and objects, and the objects' middles."""
    xmin, xmax, ymin, ymax = house.extent
    boxes = [item.bounds() for item in (*house.furnishings, *house.objects)]
    walls = []
    for wall in house.walls:
        for a, b in wall.pieces():
            if wall.along_x:
                walls.append(((a, wall.start[1]), (b, wall.start[1])))
            else:
                walls.append(((wall.start[0], a), (wall.start[0], b)))
    return GroundTruth(
        corners=np.array([(xmin, ymin), (xmax, ymax)]),
        boxes=np.array(boxes, np.float64).reshape(-1, 2, 3),
        walls=np.array(walls, np.float64).reshape(-1, 2, 2),
        objects=np.array([item.centre()[:2] for item in house.objects]).reshape(-1, 2),
    )
