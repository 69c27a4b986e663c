"""The wheel holds what it must, and its top-level names are ours."""

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {"hereabouts", "kg", "perception", "mapping", "planner"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("wheel"))


def build(project: Path, folder: Path) -> Path:
    built = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel_names(wheel: Path) -> set[str]:
    return set(zipfile.ZipFile(wheel).namelist())


def test_the_readme_has_the_size_of_the_wheel(wheel: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (megabytes,) = re.findall(r"The wheel has (\d+) MB,", readme)
    assert abs(wheel.stat().st_size / 1e6 - int(megabytes)) < 1.0


def test_the_citation_and_the_changelog_have_the_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\n" in citation
    (date,) = re.findall(r"^date-released: (\S+)$", citation, re.MULTILINE)
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    latest = re.findall(r"^## (.*)$", changelog, re.MULTILINE)[0]
    assert latest in ("Unreleased", f"{project['version']}, {date}")


def test_a_version_of_the_changelog_has_at_most_60_changes_of_one_line() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    for version in re.split(r"^## ", changelog, flags=re.MULTILINE)[1:]:
        assert version.count("\n- ") <= 60, version.partition("\n")[0]
        kinds = re.findall(r"^### (.*)$", version, re.MULTILINE)
        assert kinds == [k for k in ("Added", "Changed", "Fixed", "Removed") if k in kinds]
        assert (
            re.findall(r"^ +\S.*$", version, re.MULTILINE) == []
        )  # no change goes on in a second line


def test_wheel_has_the_five_packages(wheel_names: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel_names}
    assert {top for top in tops if not top.endswith(".dist-info")} == PACKAGES


@pytest.mark.parametrize("folder", ["ontologies", "queries"])
def test_wheel_carries_every_shipped_file(wheel_names: set[str], folder: str) -> None:
    shipped = {f"kg/{folder}/{path.name}" for path in (ROOT / folder).iterdir()}
    assert shipped
    assert shipped <= wheel_names


def test_wheel_carries_the_bundled_networks_and_their_licences(wheel_names: set[str]) -> None:
    networks = {name for name in wheel_names if name.endswith(".onnx")}
    assert networks == {
        f"perception/inference/networks/{path.name}"
        for path in (ROOT / "perception/inference/networks").glob("*.onnx")
    }
    assert len(networks) == 3
    assert any(name.endswith("NOTICE") for name in wheel_names)
    assert any(name.endswith("LICENSE") for name in wheel_names)


def test_wheel_declares_the_command(wheel_names: set[str]) -> None:
    assert any(name.endswith("entry_points.txt") for name in wheel_names)


def test_the_command_runs_as_a_module() -> None:
    run = [sys.executable, "-m", "hereabouts", "--version"]
    assert subprocess.run(run, capture_output=True, text=True, check=True).stdout.startswith(
        "hereab"
    )


def test_the_lab_is_a_wheel_of_its_own_for_the_same_version(wheel: Path, tmp_path: Path) -> None:
    lab = build(ROOT / "lab", tmp_path)
    names = set(zipfile.ZipFile(lab).namelist())
    files = (path for kind in ("*.py", "*.csv") for path in (ROOT / "lab").rglob(kind))
    tracked = {str(path.relative_to(ROOT)) for path in files}
    assert {name for name in names if ".dist-info" not in name} == tracked
    version = wheel.name.split("-")[1]
    assert lab.name.split("-")[1] == version
    assert f'"hereabouts=={version}"' in (ROOT / "lab/pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("words", [["evaluate", "map"], ["simulate", "--help"]])
def test_without_the_lab_its_commands_say_where_it_is(wheel, tmp_path, words):
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(tmp_path)
    # without the site module, so that no editable install adds the folder of this repository
    path = os.pathsep.join((str(tmp_path), sysconfig.get_path("purelib")))
    done = subprocess.run(
        [sys.executable, "-S", "-P", "-m", "hereabouts.cli", *words],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: {words[0]} comes with hereabouts-lab")
    assert "pip install ./lab" in done.stderr


@pytest.mark.parametrize("name", sorted(PACKAGES))
def test_top_level_name_is_ours(name: str) -> None:
    owners = packages_distributions().get(name, [])
    assert set(owners) <= {"hereabouts"}, f"{name} also comes with {owners}: use a venv of its own"
    module = __import__(name)
    assert Path(module.__file__).resolve().parent == ROOT / name
