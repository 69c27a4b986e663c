"""Open a network with onnxruntime, with threads chosen on purpose."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kg.errors import ModelError

# Before the import, which is when it is read: onnxruntime reports its use to its makers and keeps a
# number for this machine on disk. Nobody asked for either; who wants them sets it to 0.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime as ort
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

_FAILURES = (
    ort_errors.Fail,
    ort_errors.InvalidArgument,
    ort_errors.InvalidGraph,
    ort_errors.InvalidProtobuf,
    ort_errors.NoSuchFile,
    ort_errors.NotImplemented,
    ort_errors.RuntimeException,
)
THREADS_VARIABLE = "HEREABOUTS_THREADS"
MOST_THREADS = 4


def thread_count() -> int:
    """Threads a network computes with: $HEREABOUTS_THREADS, else half the processors, 1 to 4.

    Half, because mapper and store work beside the network, and small networks gain little. Never
    more than there are processors: thousands would start and only wait for one another.
    """
    given = os.environ.get(THREADS_VARIABLE)
    processors = os.cpu_count() or 1
    if given is None:
        return max(1, min(MOST_THREADS, processors // 2))
    if not given.isdecimal() or int(given) < 1:
        raise ModelError(f"{THREADS_VARIABLE} must be a positive whole number, got {given!r}")
    return min(int(given), processors)


class Session:
    """A network ready to run, and what it says of its inputs and outputs."""

    def __init__(self, path: Path, threads: int | None = None) -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads or thread_count()
        options.inter_op_num_threads = 1
        # a thread that spins while it waits takes the processor from whoever it waits for
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        try:
            self._session = ort.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
        except _FAILURES as error:
            reason = str(error).splitlines()[0]
            raise ModelError(f"{path} is no ONNX network that can be run: {reason}") from error
        self.path = path
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        self.inputs: dict[str, list[Any]] = {i.name: i.shape for i in self._session.get_inputs()}
        self.input_types: dict[str, str] = {i.name: i.type for i in self._session.get_inputs()}
        self.outputs: dict[str, list[Any]] = {o.name: o.shape for o in self._session.get_outputs()}

    def run(
        self, outputs: Sequence[str], inputs: dict[str, NDArray[Any]]
    ) -> list[NDArray[np.generic]]:
        """The named outputs; raises ModelError where the network refuses its inputs."""
        try:
            found: list[NDArray[np.generic]] = self._session.run(list(outputs), inputs)
        except _FAILURES as error:
            reason = str(error).splitlines()[0]
            raise ModelError(f"{self.path.name} failed on an image: {reason}") from error
        return found

    def image_size(self, name: str) -> tuple[int, int]:
        """(height, width) of image input `name`; raises ModelError unless it is [N, 3, H, W]."""
        shape = self.inputs[name]
        if len(shape) != 4 or shape[1] != 3 or not all(isinstance(x, int) for x in shape[2:]):
            raise ModelError(
                f"{self.path.name}: input {name} must be [N, 3, H, W] of fixed size, got {shape}"
            )
        if self.input_types[name] != "tensor(float)":
            raise ModelError(
                f"{self.path.name}: input {name} must be float32, got {self.input_types[name]}"
            )
        return int(shape[2]), int(shape[3])

    def interface(self) -> str:
        """Inputs and outputs in one line, for messages."""
        inputs = ", ".join(f"{name} {shape}" for name, shape in self.inputs.items())
        outputs = ", ".join(f"{name} {shape}" for name, shape in self.outputs.items())
        return f"{inputs} -> {outputs}"
