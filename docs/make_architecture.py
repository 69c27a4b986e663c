"""Draw the packages on docs/explanation/architecture.md from the import contracts.

    python docs/make_architecture.py            write the page's generated part
    python docs/make_architecture.py --check    exit code 1 where the page differs

The rooms and their order are those of the layers in pyproject.toml; each line is the docstring of
a room. The walks are listed below, and each step is the docstring of its module.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
PAGE: Final = ROOT / "docs" / "explanation" / "architecture.md"
BEGIN: Final = "<!-- made by python docs/make_architecture.py from here on; edit the source -->\n"
END: Final = "<!-- up to here -->\n"
PACKAGES: Final = ("hereabouts", "planner", "mapping", "perception", "kg")
WIDTH: Final = 122  # characters of a line
MAX_STEPS: Final = 25

#: title -> modules in the order in which the data pass them
WALKS: Final = {
    "A frame": (
        "hereabouts.cli.map_recording",
        "mapping.recording_mapper",
        "mapping.frames.read_ahead",
        "perception.sources.recording",
        "perception.camera.intrinsics",
        "perception.frames",
        "perception.inference.detector",
        "perception.inference.session",
        "mapping.mapper",
        "mapping.frames.frame_checks",
        "mapping.occupancy.occupancy_map",
        "mapping.labels.label_resolver",
        "mapping.objects.bayes_mapper",
        "mapping.objects.sightings",
        "mapping.objects.association",
        "mapping.objects.tracks",
        "mapping.objects.existence",
        "mapping.relations.relation_mapper",
        "mapping.places.place_mapper",
        "kg.model.records",
        "kg.maps.semantic_map",
        "kg.maps.stored_map",
        "kg.maps.facts.frame_writer",
        "kg.history.storage.log",
        "kg.store.transactional",
    ),
    "A SPARQL query over HTTP": (
        "kg.serving.server.http.lifecycle",
        "kg.serving.server.http.middleware",
        "kg.serving.server.app",
        "kg.serving.server.endpoints.sparql_protocol",
        "kg.serving.workers.request",
        "kg.serving.workers.pool",
        "kg.serving.workers.admission",
        "kg.store.snapshots",
        "kg.serving.workers.process",
        "kg.serving.workers.evaluation.evaluator",
        "kg.serving.workers.isolation",
        "kg.rdf.sparql.vetting",
        "kg.serving.workers.content_negotiation",
    ),
    "A find": (
        "hereabouts.cli.find",
        "kg.serving.opening",
        "kg.maps.semantic_map",
        "planner.search.plans.search_state",
        "planner.search.goals.targets",
        "kg.maps.room_statistics",
        "kg.knowledge.placement.table",
        "planner.search.goals.candidate_queries",
        "kg.maps.query.query_files",
        "kg.maps.query.evaluation",
        "mapping.persistence",
        "planner.freespace.planning_map",
        "planner.freespace.floor_plan",
        "planner.search.belief",
        "planner.search.viewpoints.candidate_views",
        "planner.search.goals.known_objects",
        "planner.search.plans.view_plan",
        "planner.search.viewpoints.next_best_view",
        "planner.search.plans.rollout",
        "planner.search.plans.report",
    ),
}


def main() -> int:
    """Write the page's generated part, or with `--check` compare it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    check = parser.parse_args().check
    differs = settle(check)
    if differs:
        print("differs:" if check else "wrote", PAGE.relative_to(ROOT))  # noqa: T201
    return int(check and differs)


def settle(check: bool) -> bool:
    """Write the page unless only checking; true where it differed."""
    old = PAGE.read_text(encoding="utf-8")
    new = with_drawing(old)
    if new != old and not check:
        PAGE.write_text(new, encoding="utf-8")
    return new != old


def with_drawing(page: str) -> str:
    """The page with its generated part made anew."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{drawing()}\n{END}{after}"


def drawing() -> str:
    """The packages with their layers, then the walks."""
    *blocks, _ = packages()
    lines = ["```text", *blocks, "```", "", "## Three walks"]
    for title, modules in WALKS.items():
        lines += ["", f"### {title}", "", *walk(modules)]
    return "\n".join(lines) + "\n"


def packages() -> Iterator[str]:
    """A block of lines for each package, the top one first."""
    for package in PACKAGES:
        for number, layer in enumerate(layers(package)):
            yield from _layer_lines(package if number == 0 else "", package, layer)
        yield ""


def layers(package: str) -> list[list[str]]:
    """The rooms of each layer of a package by its import contract, from the top down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (contract,) = (each for each in contracts if each["name"] == f"layers of {package}")
    rows = [re.split(r"\s*[|:]\s*", row) for row in contract["layers"]]
    return [[room.removeprefix(f"{package}.") for room in row] for row in rows]


def _layer_lines(head: str, package: str, rooms: Sequence[str]) -> Iterator[str]:
    """One line for each room; leaf modules of one layer share a line."""
    leaves = [room for room in rooms if _source(f"{package}.{room}").name != "__init__.py"]
    if len(leaves) == 1:
        leaves = []
    for room in rooms:
        if room not in leaves:
            yield _cut(f"{head:11}{room:18} {summary(f'{package}.{room}')}")
            head = ""
    while leaves:
        line = f"{head:11}" + leaves.pop(0)
        while leaves and len(line) + len(leaves[0]) + 2 <= WIDTH:
            line += ", " + leaves.pop(0)
        yield line
        head = ""


def walk(modules: Sequence[str]) -> Iterator[str]:
    """A numbered step for each module."""
    if len(modules) > MAX_STEPS:
        raise SystemExit(f"a walk of {len(modules)} modules; {MAX_STEPS} at most")
    for number, module in enumerate(modules, start=1):
        yield f"{number}. `{module}`: {summary(module)}"


def summary(module: str) -> str:
    """The first sentence of a module's docstring, without its full stop."""
    text = ast.get_docstring(ast.parse(_source(module).read_text(encoding="utf-8"))) or ""
    first = " ".join(text.partition("\n\n")[0].split())
    return re.split(r"(?<=[a-z)`])\. ", first)[0].removesuffix(".")


def _source(module: str) -> Path:
    path = ROOT.joinpath(*module.split("."))
    package = path / "__init__.py"
    return package if package.exists() else path.with_suffix(".py")


def _cut(line: str) -> str:
    """The line, ended at the last comma or colon that fits where it is too long."""
    if len(line) <= WIDTH:
        return line
    return re.split(r"[,:;][^,:;]*$", line[:WIDTH])[0]


if __name__ == "__main__":
    sys.exit(main())
