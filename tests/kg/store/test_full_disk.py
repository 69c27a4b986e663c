"""A disk that fills up: errors of one line, what was acknowledged stays, the map opens again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from kg.serving.opening import create_map, open_map

FILL = """
import resource, sys
from kg.model.errors import GraphError
from kg.serving.opening import open_map
errors = []
try:
    with open_map(sys.argv[1]) as semantic_map:
        # no file may grow any more, and the kernel says so as it does on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 17, resource.RLIM_INFINITY))
        for number in range(3000):
            text = f"INSERT DATA {{ <urn:n:{number}> rdfs:comment '{'x' * 500}' }}"
            try:
                semantic_map.update(text)
                print(number, flush=True)
            except GraphError as error:
                errors.append(error)
                if len(errors) == 3:
                    break
except GraphError as error:
    errors.append(error)
assert len(errors) >= 3, errors
assert all("cannot write" in str(error) for error in errors), errors
"""


def test_what_cannot_be_written_is_an_error_and_what_was_acknowledged_stays(
    tmp_path: Path,
) -> None:
    path = tmp_path / "full.map"
    create_map(path).close()
    root = Path(__file__).resolve().parents[3]
    words = [sys.executable, "-c", FILL, str(path)]
    ran = subprocess.run(words, cwd=root, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    acknowledged = [int(line) for line in ran.stdout.split()]
    assert len(acknowledged) > 10
    with open_map(path) as semantic_map:
        kept = semantic_map.query("SELECT ?s { ?s rdfs:comment ?x }").rows
        assert {f"urn:n:{number}" for number in acknowledged} <= {row[0] for row in kept}
        semantic_map.update("INSERT DATA { <urn:n:last> rdfs:comment 'room again' }")
