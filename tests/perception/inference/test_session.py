"""Networks are opened quietly: nothing is reported, and threads are counted with care."""

import os
import subprocess
import sys

import pytest

from kg.model.errors import ModelError
from perception.inference.model_zoo import default_model, model_path
from perception.inference.session import Session, available_devices, thread_count


def test_opening_a_network_leaves_no_trace_in_the_home_folder(tmp_path):
    path = model_path(default_model("scene").name)
    code = (
        f"import pathlib, perception.inference.session as s; s.Session(pathlib.Path({str(path)!r}))"
    )
    environment = os.environ | {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("ORT_DISABLE_TELEMETRY", None)
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    assert not list(tmp_path.rglob("*")), "onnxruntime kept a number for this machine"


def test_threads_are_at_least_one_and_at_most_the_processors(monkeypatch):
    processors = os.cpu_count()
    for given, expected in (("1", 1), (str(processors), processors), ("9999", processors)):
        monkeypatch.setenv("HEREABOUTS_THREADS", given)
        assert thread_count() == expected
    for nonsense in ("0", "-3", "all", "²", ""):
        monkeypatch.setenv("HEREABOUTS_THREADS", nonsense)
        with pytest.raises(ModelError, match="positive whole number"):
            thread_count()


def test_devices_are_those_that_onnxruntime_has():
    path = model_path(default_model("scene").name)
    assert "cpu" in available_devices()
    assert Session(path, device="CPU").device == "cpu"
    assert Session(path, device="auto").device in available_devices()
    with pytest.raises(ModelError, match=r"no device 'abacus' .* has: .*cpu"):
        Session(path, device="abacus")
