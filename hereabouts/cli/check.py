"""Validate the ontologies, and a map if one is given, by SHACL and the vocabulary.

Files in the folder of the map that cannot be read are findings, too, each with what would help.
Exit code 1 if anything is wrong.

example: hereabouts check kitchen.map
"""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hereabouts.cli.arguments import MAP_HELP, declare
from hereabouts.cli.console import counted, note, print_table, write_json

if TYPE_CHECKING:
    from kg.maps.semantic_map import SemanticMap


_OPTIONS = f"""
[MAP]             {MAP_HELP}
--ontologies DIR  folder of ontologies to check
--json
"""


def add(parser: argparse.ArgumentParser) -> None:
    declare(parser, _OPTIONS)


def run(arguments: argparse.Namespace) -> int:
    from kg.knowledge.ontology.lint import check_map, check_ontologies
    from kg.knowledge.ontology.unused import unused_statements
    from kg.model.resources import ONTOLOGIES
    from kg.rdf.findings import Finding
    from kg.serving.opening import open_map
    from mapping.keepers.kept_files import unreadable_files

    folder = Path(arguments.ontologies) if arguments.ontologies else ONTOLOGIES
    findings = list(check_ontologies(folder))
    if arguments.map is not None:
        with open_map(arguments.map, read_only=True) as semantic_map:
            findings += check_map(semantic_map.engine)
            findings += [
                Finding(str(path), problem) for path, problem in unreadable_files(semantic_map)
            ]
            for recording in semantic_map.recordings():
                if recording.pose_estimate:
                    note(f"{recording.name}: estimated {recording.pose_estimate}")
            for warning in unused_statements(semantic_map.ontology.quads()):
                note(str(warning))
            _note_missing_history(semantic_map)
            if semantic_map.description.licence is None:
                note(f"no licence: hereabouts describe {arguments.map} --licence IRI sets one")
    if arguments.json:
        write_json([asdict(finding) for finding in findings])
    elif findings:
        print_table(
            ("severity", "subject", "property", "value", "problem"),
            [(f.severity, f.focus, f.path, f.value, f.message) for f in findings],
        )
    wrong = sum(finding.severity == "violation" for finding in findings)
    warned = f", {counted(len(findings) - wrong, 'warning')}" if wrong < len(findings) else ""
    note(f"{counted(wrong, 'finding')}{warned}")
    return 1 if wrong else 0


def _note_missing_history(semantic_map: SemanticMap) -> None:
    """Warn where a folder has lost its history, as an incomplete copy has."""
    from kg.model.errors import HistoryError

    try:
        _ = semantic_map.history.log
    except HistoryError as error:
        note(f"{error}, without what happened before")
