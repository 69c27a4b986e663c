"""A command loads the libraries that it works with, and no others."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kg.serving.opening import create_map

HEAVY = {
    *("cv2", "matplotlib", "networkx", "onnxruntime", "owlready2", "pyshacl", "rdflib"),
    *("requests", "rich", "shapely", "starlette", "uvicorn"),
}
RUN = """
import sys
from hereabouts.cli import main
try:
    code = main(sys.argv[1:])
except SystemExit as end:
    code = end.code
print("loaded:", *sorted({name.partition(".")[0] for name in sys.modules}), file=sys.stderr)
sys.exit(code)
"""


def loaded(*words: str) -> set[str]:
    """The top-level modules that a command has loaded when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, *words], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return set(done.stderr.rpartition("loaded:")[2].split())


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_what_needs_no_map_loads_no_library(option: str) -> None:
    assert not loaded(option) & {*HEAVY, "numpy"}


def test_questions_to_a_map_in_a_folder_load_the_engine_alone(tmp_path: Path) -> None:
    path = tmp_path / "home.map"
    with create_map(path) as home:
        iri = home.new_object_iri()
        home.update(f"INSERT DATA {{ <{iri}> a here:Cup ; here:x 1.0 ; here:y 1.0 ; here:z 1.0 }}")
    for words in (
        ("ask", str(path), "objects"),
        ("why", str(path), iri, "--json"),
        ("log", str(path), iri),
    ):
        assert not loaded(*words) & HEAVY


def threads(path: Path, **settings: str) -> int:
    """Threads of a process that has asked the map at `path` and imported numpy."""
    program = (
        "import os, sys; from hereabouts.cli import main; main();"
        "import numpy; print(len(os.listdir('/proc/self/task')), file=sys.stderr)"
    )
    given = {name: text for name, text in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", program, "ask", str(path), "objects"]
    done = subprocess.run(command, env=given | settings, capture_output=True, text=True, check=True)
    return int(done.stderr.split()[-1])


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="Linux lists threads there")
def test_a_command_starts_no_threads_for_small_matrices_unless_told(tmp_path: Path) -> None:
    create_map(tmp_path / "home.map").close()
    assert threads(tmp_path / "home.map", OPENBLAS_NUM_THREADS="2") == 1 + threads(
        tmp_path / "home.map"
    )
