"""Explain a thing or a fact: the frame, rule, model, source or person behind it.

The explanation goes back to the box and camera pose, and to the transaction that wrote the fact.

examples: hereabouts why kitchen.map object/17; hereabouts why kitchen.map 'object/17 here:inPlace
place/1'; hereabouts why kitchen.map --candidates keyboard
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import declare
from hereabouts.cli.console import out, write, write_json

if TYPE_CHECKING:
    from rich.tree import Tree

    from kg.history.reports.explanation import Explanation
    from kg.maps.semantic_map import SemanticMap


_OPTIONS = """
MAP
[WHAT ...]                   object/17, place/1, a label such as 'cup 2', or an IRI; or subject,
                             predicate and optional object of a fact
--candidates [CATEGORY ...]  the fates of all detections, or of a category's detections, and the
                             things that were seen but are not believed
--format                     how to print it (ttl: SOSA and PROV-O; default: tree)
--json -> format             as --format json
"""


def add(parser: argparse.ArgumentParser) -> None:
    formats = {"choices": ("tree", "json", "ttl"), "default": "tree"}
    declare(parser, _OPTIONS, format=formats)


def run(arguments: argparse.Namespace) -> int:
    if arguments.candidates is not None:
        return _candidates(arguments)
    if not arguments.what:
        arguments.usage_error("give WHAT to explain, e.g. object/17, or --candidates")
    from kg.history.reports.prov_export import provenance
    from kg.serving.opening import open_map
    from planner.search.goals.place_names import fact_named

    with open_map(arguments.map, read_only=True) as semantic_map:
        what = fact_named(semantic_map, " ".join(arguments.what))
        reasons = semantic_map.history.explain(what)
        pictures = _pictures(semantic_map, reasons)
    if arguments.format == "ttl":
        write(provenance(*reasons))
    elif arguments.format == "json":
        write_json([_record(reason) for reason in reasons])
    else:
        for reason in reasons:
            out().print(_tree(reason), soft_wrap=True)
        for path in pictures:
            write(f"picture: {path}")
    return 0


def _candidates(arguments: argparse.Namespace) -> int:
    """Print the fates of detections."""
    from hereabouts.cli.candidates import explain_detections
    from kg.serving.opening import open_map

    if arguments.format == "ttl":
        arguments.usage_error("--candidates cannot be printed as Turtle; use --json")
    with open_map(arguments.map, read_only=True) as semantic_map:
        category = " ".join([*arguments.candidates, *arguments.what])
        return explain_detections(semantic_map, category, json=arguments.format == "json")


def _pictures(semantic_map: SemanticMap, reasons: Sequence[Explanation]) -> list[Path]:
    """Pictures of the explained objects in the map's folder."""
    from kg.maps.object_pictures import ObjectPictures

    folder = semantic_map.store.path
    if folder is None:
        return []
    pictures = ObjectPictures(folder)
    records = semantic_map.perceived.objects({r.iri for r in reasons if r.iri is not None})
    return [path for record in records if (path := pictures.path_of(record)) is not None]


def _tree(reason: Explanation) -> Tree:
    from rich.text import Text
    from rich.tree import Tree

    tree = Tree(Text(reason.text, style="bold"), guide_style="dim")
    _grow(tree, reason)
    return tree


def _grow(tree: Tree, reason: Explanation) -> None:
    from rich.text import Text

    from kg.history.reports.events import label_of

    for behind in reason.because:
        _grow(tree.add(Text.assemble((label_of(behind), "dim"), behind.text)), behind)


def _record(reason: Explanation) -> dict[str, object]:
    return {
        "kind": reason.kind,
        "text": reason.text,
        "iri": reason.iri,
        "because": [_record(behind) for behind in reason.because],
    }
