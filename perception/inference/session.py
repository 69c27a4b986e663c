"""Sessions: networks opened with onnxruntime, and images brought to the size of their input."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kg.model.errors import ModelError

# onnxruntime reports its use to its makers and keeps a number of this machine on disk, unless this
# variable is set before the import. Users who want that set it to 0.
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
MAX_THREADS = 4
#: a thread that spins while it waits takes the processor from the thread that it waits for
SPINNING: Final = "0"
#: [px] side of the input of a network that takes any size and names none, ...
USUAL_SIZE = 640
MAX_SIZE = 4096  # ... and the largest side of any
_SUFFIX = "ExecutionProvider"
_QUIET = ort.RunOptions()
_QUIET.log_severity_level = 4  # a run that fails raises, and is not told on stderr as well
#: devices that "auto" takes, best first; TensorRT builds its plans for minutes
_PREFERRED = ("cuda", "migraphx", "rocm", "dml", "cpu")
#: types of images, by onnxruntime's names
_TYPES: Final = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
}
_NO_DEVICES = ("azure",)  # a provider that sends images away


def thread_count() -> int:
    """Threads a network computes with: $HEREABOUTS_THREADS, else half the processors, 1 to 4.

    Half, because mapper and store work beside the network, and small networks gain little. Never
    more than there are processors: thousands would start and only wait for one another.
    """
    given = os.environ.get(THREADS_VARIABLE)
    processors = os.cpu_count() or 1
    if given is None:
        return max(1, min(MAX_THREADS, processors // 2))
    if not given.isdecimal() or int(given) < 1:
        raise ModelError(f"{THREADS_VARIABLE} must be a positive whole number, got {given!r}")
    return min(int(given), processors)


def available_devices() -> tuple[str, ...]:
    """Devices that this onnxruntime was built for: "cpu", "cuda", ..., in its order."""
    names = (name.removesuffix(_SUFFIX).lower() for name in ort.get_available_providers())
    return tuple(name for name in names if name not in _NO_DEVICES)


def provider_of(device: str) -> str:
    """onnxruntime's name of the provider of `device`; "auto" is the best one there is.

    Raises ModelError, with the devices available, for any other.
    """
    available = available_devices()
    wanted = device.lower()
    if wanted == "auto":
        wanted = next(name for name in (*_PREFERRED, *available) if name in available)
    for name in ort.get_available_providers():
        if wanted in available and name.removesuffix(_SUFFIX).lower() == wanted:
            return str(name)
    raise ModelError(
        f"no device {device!r} for networks; this onnxruntime has: {', '.join(available)}"
        + ("" if "cuda" in available else " (pip install onnxruntime-gpu adds cuda)")
    )


class Session:
    """A network ready to run, with its inputs, outputs and metadata.

    `device`: "auto", or one of `available_devices`. Raises ModelError for a file that is no
    network, and where a device that is named does not work.
    """

    def __init__(self, path: Path, threads: int | None = None, device: str = "cpu") -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = threads or thread_count()
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", SPINNING)
        options.log_severity_level = 3
        provider = provider_of(device)
        providers = list(dict.fromkeys((provider, f"CPU{_SUFFIX}")))
        try:
            self._session = ort.InferenceSession(str(path), options, providers=providers)
        except _FAILURES as error:
            raise ModelError(
                f"{path} is no ONNX network that can be run ({_reason(error)}); its whole file, "
                "downloaded or exported again, would work"
            ) from error
        self.path = path
        taken = self._session.get_providers()[0]
        self.device: str = taken.removesuffix(_SUFFIX).lower()  # the one that was taken
        if taken != provider and device.lower() != "auto":
            raise ModelError(
                f"device {device!r} does not work here, its libraries are missing; "
                f"--device {self.device} does"
            )
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        self.inputs: dict[str, list[Any]] = {i.name: i.shape for i in self._session.get_inputs()}
        self.input_types: dict[str, str] = {i.name: i.type for i in self._session.get_inputs()}
        outputs = self._session.get_outputs()
        self.outputs: dict[str, list[Any]] = {o.name: o.shape for o in outputs}
        self.output_types: dict[str, str] = {o.name: o.type for o in outputs}
        if not self.inputs or not self.outputs:
            raise ModelError(f"{path} has no inputs or no outputs")

    def run(
        self, outputs: Sequence[str], inputs: dict[str, NDArray[Any]]
    ) -> list[NDArray[np.generic]]:
        """The named outputs; raises ModelError where the network refuses its inputs."""
        try:
            adapted = {name: self._adapted(name, value) for name, value in inputs.items()}
            found: list[NDArray[np.generic]] = self._session.run(list(outputs), adapted, _QUIET)
        except _FAILURES as error:
            raise ModelError(f"{self.path.name} refuses its input: {_reason(error)}") from error
        return found

    def _adapted(self, name: str, value: NDArray[Any]) -> NDArray[Any]:
        """An input [1, ...] by the axes, the type and the number of images that it declares."""
        shape = self.inputs[name]
        if value.ndim == 4:
            if len(shape) == 3:
                value, shape = value[0], [None, *shape]
            if self.is_channels_last(name):
                value = np.ascontiguousarray(np.moveaxis(value, -3, -1))
        if value.ndim == len(shape) and isinstance(shape[0], int) and len(value) == 1:
            value = np.repeat(value, max(shape[0], 1), axis=0)
        type_ = np.dtype(_TYPES.get(self.input_types[name], value.dtype))
        whole = type_.kind == "u" and value.dtype != type_
        return (np.rint(value) if whole else value).astype(type_, copy=False)

    def is_channels_last(self, name: str) -> bool:
        """Whether an image's colours are the last axis: [N, H, W, 3]."""
        shape = self.inputs[name]
        return len(shape) in (3, 4) and shape[-1] == 3 and shape[-3] != 3

    def takes_bytes(self, name: str) -> bool:
        """Whether an image input takes values of 0 to 255 by its type."""
        return self.input_types[name] == "tensor(uint8)"

    def image_size(self, name: str, usual: tuple[int, int] | None = None) -> tuple[int, int]:
        """(height, width) of image input `name`: [N, 3, H, W] or [3, H, W], or colours last.

        One that takes any size gets the `usual` one, by default that of the metadata `imgsz`, else
        640 x 640. Raises ModelError for an input that is no such image.
        """
        shape = self.inputs[name][-3:]
        if self.is_channels_last(name):
            shape = [3, *shape[:2]]
        if len(self.inputs[name]) not in (3, 4) or (isinstance(shape[0], int) and shape[0] != 3):
            raise ModelError(
                f"{self.path.name}: input {name} must be [N, 3, H, W] or [N, H, W, 3], got "
                f"{self.inputs[name]}"
            )
        if self.input_types[name] not in _TYPES:
            raise ModelError(
                f"{self.path.name}: input {name} must be float32, float16 or uint8, got "
                f"{self.input_types[name]}"
            )
        height, width = (
            side if isinstance(side, int) else other
            for side, other in zip(shape[1:], usual or self._usual_size(), strict=True)
        )
        if not 0 < min(height, width) <= max(height, width) <= MAX_SIZE:
            raise ModelError(
                f"{self.path.name}: input {name} is {width} x {height}; "
                f"up to {MAX_SIZE} a side would work"
            )
        return int(height), int(width)

    def _usual_size(self) -> tuple[int, int]:
        """(height, width) of the metadata's `imgsz`, as exporters write it: [640, 640]."""
        try:
            height, width = json.loads(self.metadata.get("imgsz", ""))
            return int(height), int(width)
        except (ValueError, TypeError):
            return USUAL_SIZE, USUAL_SIZE

    def interface(self) -> str:
        """Inputs and outputs in one line, for messages."""
        inputs = ", ".join(f"{name} {shape}" for name, shape in self.inputs.items())
        outputs = ", ".join(f"{name} {shape}" for name, shape in self.outputs.items())
        return f"{inputs} -> {outputs}"


def _reason(error: Exception) -> str:
    """The complaint of onnxruntime, without its codes and the path of the file."""
    line = str(error).splitlines()[0].rpartition(" : ")[2]
    return line.rpartition(" failed:")[2].strip().rstrip(".")


PAD = 114  # grey that letterboxed networks were trained with
CROP_MARGIN = 256 / 224  # shorter side over crop, as classifiers are evaluated
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], np.float32) * 255
IMAGENET_SCALE = np.array([0.229, 0.224, 0.225], np.float32) * 255
RESIZES = ("stretch", "letterbox", "crop")
VALUES = ("0..255", "0..1", "imagenet", "0..255 bgr", "0..1 bgr", "imagenet bgr")


@dataclass(frozen=True, slots=True)
class Fitted:
    """A network's input, and the way back: image pixel = (input pixel - shift) / scale."""

    tensor: NDArray[np.float32]  # (1, 3, H, W)
    scale: tuple[float, float]  # x, y
    shift: tuple[float, float]  # x, y [px of the input]

    def to_image(self, xyxy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Boxes (n, 4) [px of the input] in pixels of the image."""
        back: NDArray[np.float64] = (xyxy - np.array(self.shift * 2)) / np.array(self.scale * 2)
        return back.astype(np.float32)


def fit(rgb: NDArray[np.uint8], size: tuple[int, int], resize: str, values: str) -> Fitted:
    """Input of `size` (height, width) for a network, from an image `rgb` (H, W, 3).

    `resize`: "stretch" to the size, "letterbox" (aspect kept, grey below and right), "crop" (the
    centre, after shrinking the shorter side). `values`: "0..255", "0..1" or "imagenet" (mean and
    deviation), and " bgr" behind it where blue comes first.
    """
    height, width = size
    old_height, old_width = rgb.shape[:2]
    ratios = (width / old_width, height / old_height)
    if resize == "stretch":
        return Fitted(_tensor(_resized(rgb, width, height), values), ratios, (0.0, 0.0))
    factor = min(ratios) if resize == "letterbox" else max(ratios) * CROP_MARGIN
    small = _resized(rgb, max(round(old_width * factor), 1), max(round(old_height * factor), 1))
    if resize == "letterbox":
        canvas = np.full((height, width, 3), PAD, np.uint8)
        canvas[: small.shape[0], : small.shape[1]] = small
        return Fitted(_tensor(canvas, values), (factor, factor), (0.0, 0.0))
    left, top = (small.shape[1] - width) // 2, (small.shape[0] - height) // 2
    cut = small[top : top + height, left : left + width]
    return Fitted(_tensor(cut, values), (factor, factor), (-float(left), -float(top)))


def _resized(rgb: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    shape = (height, width)
    if rgb.shape[:2] == shape:
        return rgb
    return cv2.resize(rgb, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.uint8)


def _tensor(rgb: NDArray[np.uint8], values: str) -> NDArray[np.float32]:
    pixels = rgb.astype(np.float32)
    scale, _, order = values.partition(" ")
    if scale == "0..1":
        pixels /= 255
    elif scale == "imagenet":
        pixels = (pixels - IMAGENET_MEAN) / IMAGENET_SCALE
    if order == "bgr":
        pixels = pixels[:, :, ::-1]
    return np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])
