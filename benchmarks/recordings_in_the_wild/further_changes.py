"""Changes of a robot's recording: sensors, calibrations and poses as drivers and SLAM have them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import cv2
import numpy as np

from benchmarks.recordings_in_the_wild.image_changes import depth_of, each, packed, rgb_of
from benchmarks.recordings_in_the_wild.robot import (
    COLOUR,
    COMPRESSED,
    DEPTH,
    DEPTH_INFO,
    INFO,
    STATIC,
    TF,
    Change,
    Message,
    Messages,
    changed,
    image,
    stamped,
)

POINTS: Final = "sensor_msgs/msg/PointCloud2"
STEREO: Final = "stereo_msgs/msg/DisparityImage"


def resized_depth(width: int, height: int) -> Change:
    """Registered depth of another size, with its CameraInfo."""

    def depth(m: Message) -> Message:
        small = cv2.resize(depth_of(m), (width, height), interpolation=cv2.INTER_NEAREST)
        return changed(m, **image(0, "", small, "16UC1") | {"header": m.fields["header"]})

    return lambda messages: [
        depth(m) if m.topic == DEPTH else _scaled(m, width, height) if m.topic == DEPTH_INFO else m
        for m in messages
    ]


def _scaled(m: Message, width: int, height: int) -> Message:
    f = m.fields
    K = np.array(f["k"]).reshape(3, 3).copy()
    K[0] *= width / f["width"]
    K[1] *= height / f["height"]
    return changed(m, k=K.ravel(), width=width, height=height)


def of_frames(topic: str, numbers: range, how: Callable[[Message], Message]) -> Change:
    """A change of some of a topic's messages, by their places."""

    def change(messages: Messages) -> Messages:
        chosen = {id([m for m in messages if m.topic == topic][n]) for n in numbers}
        return [how(m) if id(m) in chosen else m for m in messages]

    return change


def times(factor: float) -> Callable[[Message], Message]:
    """Depth in another unit."""
    return lambda m: packed(m, (depth_of(m) * factor).astype(np.uint16), "16UC1")


def smaller(m: Message) -> Message:
    """Colour of half the size."""
    half = np.ascontiguousarray(rgb_of(m)[::2, ::2])
    return changed(m, **image(0, "", half, "rgb8") | {"header": m.fields["header"]})


def mirrored(m: Message) -> Message:
    """Colour flipped left to right."""
    return packed(m, np.ascontiguousarray(rgb_of(m)[:, ::-1]), "rgb8")


def wider_depth(share: float) -> Change:
    """Depth of a wider lens at the same place and of the same size, by its own CameraInfo."""

    def depth(m: Message) -> Message:
        mm = depth_of(m)
        height, width = mm.shape
        # every pixel of the wide image lies at `share` of its distance from the middle
        across = (np.arange(width) - width / 2) / share + width / 2
        down = (np.arange(height) - height / 2) / share + height / 2
        x, y = np.meshgrid(across, down)
        wide = cv2.remap(mm, x.astype(np.float32), y.astype(np.float32), cv2.INTER_NEAREST)
        return packed(m, np.asarray(wide, np.uint16), "16UC1")

    def info(m: Message) -> Message:
        K = np.array(m.fields["k"]).reshape(3, 3).copy()
        width, height = m.fields["width"], m.fields["height"]
        K[:2, :2] *= share
        K[0, 2] = (K[0, 2] - width / 2) * share + width / 2
        K[1, 2] = (K[1, 2] - height / 2) * share + height / 2
        return changed(m, k=K.ravel())

    return lambda messages: [
        depth(m) if m.topic == DEPTH else info(m) if m.topic == DEPTH_INFO else m for m in messages
    ]


def cropped(*, binning: int = 1) -> Change:
    """CameraInfo of a sensor whose images show a region of it, in bins of pixels."""

    def change(m: Message) -> Message:
        if m.topic not in (INFO, DEPTH_INFO):
            return m
        f = m.fields
        K = np.array(f["k"]).reshape(3, 3).copy()
        K[:2] *= binning
        K[0, 2] += 64 * binning
        K[1, 2] += 48 * binning
        width, height = f["width"] * binning, f["height"] * binning
        roi = {"x_offset": 64 * binning, "y_offset": 48 * binning, "width": width, "height": height}
        return changed(m, k=K.ravel(), roi=roi, width=width + 128, height=height + 96,
                       binning_x=binning, binning_y=binning)  # fmt: skip

    return lambda messages: [change(m) for m in messages]


def rectified(messages: Messages) -> Messages:
    """image_rect, whose CameraInfo has the raw image's K and D beside P."""

    def change(m: Message) -> Message:
        if m.topic not in (INFO, DEPTH_INFO):
            return m
        K = np.array(m.fields["k"]).reshape(3, 3).copy()
        K[:2, :2] *= 1.08
        return changed(m, k=K.ravel(), d=np.array([0.1, -0.2, 0.001, 0.001, 0.0]))

    return [change(m) for m in messages]


def grey(messages: Messages) -> Messages:
    """Images of an infrared camera."""
    return each(COLOUR, lambda m: packed(m, cv2.cvtColor(rgb_of(m), cv2.COLOR_RGB2GRAY), "mono8"))(
        messages
    )


def only(type_: str, topic: str, *, of: str) -> Change:
    """Messages of a type that is no image, in place of a topic; they are empty but for a header."""

    def change(m: Message) -> Message:
        fields: dict[str, Any] = {"header": m.fields["header"]}
        if type_ == STEREO:
            fields["image"] = m.fields
        return Message(m.time, topic, type_, fields)

    return each(of, change)


def video(type_: str, suffix: str, form: str = "") -> Change:
    """Packets of video in place of colour images."""

    def change(m: Message) -> Message:
        head = m.fields["header"]
        packet = np.frombuffer(b"\0\0\0\1\x67\x42\0\x1e" + bytes(2000), np.uint8)
        fields = {"header": head, "timestamp": head["stamp"], "frame_id": head["frame_id"],
                  "format": form, "encoding": "libx264", "data": packet}  # fmt: skip
        return Message(m.time, COLOUR + suffix, type_, fields)

    return each(COLOUR, change)


def bad_turns(how: Callable[[dict[str, float], int], dict[str, float]]) -> Change:
    """Rotations of moving tf changed by `how(rotation, number)`."""

    def change(messages: Messages) -> Messages:
        out, number = Messages(), 0
        for m in messages:
            if m.topic == "/tf":
                number += 1
                one = m.fields["transforms"][0]
                turned = one["transform"] | {"rotation": how(one["transform"]["rotation"], number)}
                m = changed(m, transforms=[one | {"transform": turned}])
            out.append(m)
        return out

    return change


def of_link(child: str, keep: Callable[[int], bool]) -> Change:
    """Messages of a link of tf, by number."""

    def change(messages: Messages) -> Messages:
        out, number = Messages(), -1
        for m in messages:
            if m.topic == "/tf" and m.fields["transforms"][0]["child_frame_id"] == child:
                number += 1
                if not keep(number):
                    continue
            out.append(m)
        return out

    return change


def corrected(messages: Messages) -> Messages:
    """Odometry that drifts by 6 cm a second, and a SLAM that corrects it each second by a jump."""
    first = min(m.time for m in messages)

    def drift(seconds: float) -> float:
        return 0.06 * seconds

    def change(m: Message) -> Message:
        if m.topic != "/tf":
            return m
        one = m.fields["transforms"][0]
        seconds = (m.time - first) / 1e9
        off = drift(seconds) if one["child_frame_id"] == "base_link" else -drift(int(seconds))
        place = dict(one["transform"]["translation"])
        if one["child_frame_id"] == "base_link":
            place["x"] += off
        else:  # the map's axes are turned by 0.6 rad
            place["x"] += off * float(np.cos(0.6))
            place["y"] += off * float(np.sin(0.6))
        return changed(
            m, transforms=[one | {"transform": one["transform"] | {"translation": place}}]
        )

    return [change(m) for m in messages]


def moved_stamps(*topics: str, to: float) -> Change:
    """Stamps of topics that begin at `to` [s]; recording times stay."""

    def change(messages: Messages) -> Messages:
        first = min(m.time for m in messages)
        return [
            stamped(m, m.time - first + round(to * 1e9)) if not topics or m.topic in topics else m
            for m in messages
        ]

    return change


def coarse_stamps(messages: Messages) -> Messages:
    """Images stamped by a clock of 0.2 s, so that two have one stamp."""
    step = 200_000_000
    return [
        stamped(m, m.time // step * step) if m.topic in (COLOUR, DEPTH, INFO, DEPTH_INFO) else m
        for m in messages
    ]


def with_step(topic: str, step: Callable[[int], int]) -> Change:
    """Images whose drivers fill in a wrong length of rows."""
    return each(topic, lambda m: changed(m, step=step(m.fields["width"])))


def annotated(messages: Messages) -> Messages:
    """Images beside, of a detector that draws into them, as many, of names without colour."""
    out = Messages()
    for m in messages:
        if m.topic == COLOUR:
            m = replace(m, topic="/camera/image_raw")
            box = cv2.rectangle(rgb_of(m).copy(), (20, 20), (300, 220), (0, 255, 0), 60)
            drawn = packed(m, np.asarray(box, np.uint8), "rgb8")
            out.append(replace(drawn, topic="/a_detector/image"))
        elif m.topic == INFO:
            m = replace(m, topic="/camera/camera_info")
        out.append(m)
    return out


def many_frames(count: int) -> Change:
    """A tree of tf with many more frames, in a chain below base_link and beside it."""

    def change(messages: Messages) -> Messages:
        at = messages[0].fields["transforms"][0]["header"]["stamp"]
        links = [
            {"header": {"stamp": at, "frame_id": f"joint_{n // 2}" if n else "base_link"},
             "child_frame_id": f"joint_{n + 1}", "transform": {"rotation": {"w": 1.0}}}
            for n in range(count)
        ]  # fmt: skip
        return [Message(messages[0].time, STATIC, TF, {"transforms": links}), *messages]

    return change


def pictures_of_depth(messages: Messages) -> Messages:
    """Depth as coloured pictures."""

    def change(m: Message) -> Message:
        near = np.clip(depth_of(m) // 16, 0, 255).astype(np.uint8)
        drawn = np.asarray(cv2.applyColorMap(near, cv2.COLORMAP_JET), np.uint8)
        data = cv2.imencode(".jpg", drawn)[1].ravel()
        fields = {
            "header": m.fields["header"],
            "format": "bgr8; jpeg compressed bgr8",
            "data": data,
        }
        return Message(m.time, f"{DEPTH}/compressed", COMPRESSED, fields)

    return each(DEPTH, change)(messages)
