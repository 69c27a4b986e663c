"""Changes of a robot's recording: other encodings, names and sources of poses, and losses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.recordings_in_the_wild.image_changes import depth_of, each, packed
from benchmarks.recordings_in_the_wild.robot import (
    CAMERA_INFO,
    COLOUR,
    DEPTH,
    DEPTH_INFO,
    IMAGE,
    INFO,
    ODOMETRY,
    OPTICAL,
    PATH,
    POSE,
    POSE_COVARIANCE,
    STATIC,
    T_BASE_CAM,
    T_MAP_ODOM,
    TF,
    Change,
    Message,
    Messages,
    Shot,
    changed,
    framed,
    header,
    odometry,
    posed,
    stamped,
    transform,
)
from perception.camera.poses import BODY_FROM_CAMERA, Pose


def without(*topics: str) -> Change:
    """Topics that were not recorded."""
    return lambda messages: [m for m in messages if m.topic not in topics]


def without_link(*children: str) -> Change:
    """Links of tf that were not recorded."""
    return lambda messages: [
        m
        for m in messages
        if m.type != TF or m.fields["transforms"][0]["child_frame_id"] not in children
    ]


def renamed(**names: str) -> Change:
    """Other names of the topics COLOUR, DEPTH, INFO, DEPTH_INFO."""
    known = {"colour": COLOUR, "depth": DEPTH, "info": INFO, "depth_info": DEPTH_INFO}
    table = {known[short]: name for short, name in names.items()}
    return lambda messages: [replace(m, topic=table.get(m.topic, m.topic)) for m in messages]


def reframed(**frames: str) -> Change:
    """Other names of frames, everywhere; `a__b` stands for a/b."""

    def name(old: str) -> str:
        return frames.get(old, old)

    def change(m: Message) -> Message:
        if m.type != TF:
            return framed(m, name(m.fields["header"]["frame_id"]))
        links = [
            one
            | {
                "header": one["header"] | {"frame_id": name(one["header"]["frame_id"])},
                "child_frame_id": name(one["child_frame_id"]),
            }
            for one in m.fields["transforms"]
        ]
        return changed(m, transforms=links)

    return lambda messages: [change(m) for m in messages]


def image_frames(frame: str, *topics: str) -> Change:
    """Another frame in the headers of images and cameras only."""
    chosen = topics or (COLOUR, DEPTH, INFO, DEPTH_INFO)
    return lambda messages: [framed(m, frame) if m.topic in chosen else m for m in messages]


def later(topic: str, nanoseconds: int) -> Change:
    """Stamps of a topic later by so much."""

    def change(m: Message) -> Message:
        return stamped(m, _stamp(m) + nanoseconds)

    return each(topic, change)


def _stamp(m: Message) -> int:
    first = m.fields["transforms"][0] if m.type == TF else m.fields
    stamp = first["header"]["stamp"]
    return int(stamp["sec"]) * 10**9 + int(stamp["nanosec"])


def first_only(*topics: str) -> Change:
    """Topics that are latched: only their first message was recorded."""

    def change(messages: Messages) -> Messages:
        seen, kept = set[str](), Messages()
        for m in messages:
            if m.topic not in topics or m.topic not in seen:
                kept.append(m)
            seen.add(m.topic)
        return kept

    return change


def uncalibrated(*topics: str, first: int | None = None, with_p: bool = False) -> Change:
    """Cameras whose K is 0, and P unless `with_p`, in the first messages or in all."""

    def change(messages: Messages) -> Messages:
        seen, out = dict[str, int](), Messages()
        for m in messages:
            number = seen[m.topic] = seen.get(m.topic, 0) + 1
            zero = m.topic in topics and (first is None or number <= first)
            fields = {"k": np.zeros(9)} | ({} if with_p else {"p": np.zeros(12)})
            out.append(changed(m, **fields) if zero else m)
        return out

    return change


def of_another_moment(topic: str, first: int, last: int, back: int = 10) -> Change:
    """The messages from `first` to before `last` have the pixels of those `back` before them."""

    def change(messages: Messages) -> Messages:
        of_topic = [m for m in messages if m.topic == topic]
        number, out = iter(range(len(of_topic))), Messages()
        for m in messages:
            n = next(number) if m.topic == topic else -1
            late = first <= n < last
            out.append(changed(m, data=of_topic[n - back].fields["data"]) if late else m)
        return out

    return change


def after(seconds: float, *topics: str) -> Change:
    """Topics whose recording began late."""

    def change(messages: Messages) -> Messages:
        begin = min(m.time for m in messages) + round(seconds * 1e9)
        return [m for m in messages if m.topic not in topics or m.time >= begin]

    return change


def poses_of_camera(shots: Sequence[Shot]) -> dict[int, Pose]:
    """Camera poses by stamp [ns]."""
    return {shot.stamp: shot.T_map_cam for shot in shots}


def other_poses(
    make: Callable[[int, Pose], Message | None], *, keep_static: bool = True
) -> Callable[[Sequence[Shot]], Change]:
    """Poses of another kind instead of tf: `make` gives the message of a stamp and camera pose."""

    def of(shots: Sequence[Shot]) -> Change:
        def change(messages: Messages) -> Messages:
            left = [m for m in messages if m.type != TF or (keep_static and m.topic == STATIC)]
            said = [make(stamp, T) for stamp, T in poses_of_camera(shots).items()]
            return sorted([m for m in said if m is not None] + left, key=lambda m: m.time)

        return change

    return of


def base_pose(T: Pose) -> Pose:
    """Pose of base_link in odom by the camera's pose in the map."""
    out: Pose = np.linalg.inv(T_MAP_ODOM) @ T @ np.linalg.inv(T_BASE_CAM)
    return out


def body_pose(T: Pose) -> Pose:
    """Pose of a body with x ahead that sits where the camera is."""
    out: Pose = T @ np.linalg.inv(BODY_FROM_CAMERA)
    return out


def odometry_of(child: str, of: Callable[[Pose], Pose], parent: str = "odom",
                topic: str = "/odom") -> Callable[[int, Pose], Message]:  # fmt: skip
    """Odometry of a frame."""
    return lambda at, T: Message(at, topic, ODOMETRY, odometry(at, parent, child, of(T)))


def pose_of(topic: str, of: Callable[[Pose], Pose], parent: str = "map", *,
            covariance: bool = False) -> Callable[[int, Pose], Message]:  # fmt: skip
    """PoseStamped, or PoseWithCovarianceStamped, of a frame it does not name."""

    def make(at: int, T: Pose) -> Message:
        fields = posed(at, parent, of(T))
        if covariance:
            return Message(at, topic, POSE_COVARIANCE, fields | {"pose": {"pose": fields["pose"]}})
        return Message(at, topic, POSE, fields)

    return make


def path_of(topic: str, of: Callable[[Pose], Pose]) -> Callable[[Sequence[Shot]], Change]:
    """A nav_msgs/Path that grows, instead of tf."""

    def of_shots(shots: Sequence[Shot]) -> Change:
        def change(messages: Messages) -> Messages:
            left = [m for m in messages if m.type != TF or m.topic == STATIC]
            poses: list[dict[str, Any]] = []
            for shot in shots:
                poses.append(posed(shot.stamp, "map", of(shot.T_map_cam)))
                fields = {"header": header(shot.stamp, "map"), "poses": list(poses)}
                left.append(Message(shot.stamp, topic, PATH, fields))
            return sorted(left, key=lambda m: m.time)

        return change

    return of_shots


def with_links(*links: tuple[str, str, Pose], topic: str = "/tf") -> Change:
    """Further links of tf, at each image's stamp."""

    def change(messages: Messages) -> Messages:
        out = Messages()
        for m in messages:
            out.append(m)
            if m.topic == COLOUR:
                out += [Message(m.time, topic, TF, transform(_stamp(m), *link)) for link in links]
        return out

    return change


def second_robot(messages: Messages) -> Messages:
    """Two robots with the same frames: /r1 as it is, /r2 with other poses and depth in 1/256 m."""
    out = Messages()
    for m in messages:
        out.append(replace(m, topic=f"/r1{m.topic}"))
        other = replace(m, topic=f"/r2{m.topic}")
        if m.topic == DEPTH:
            other = packed(other, (depth_of(m) * 0.256).astype(np.uint16), "16UC1")
        if m.topic == "/tf" and m.fields["transforms"][0]["child_frame_id"] == "base_link":
            number = (_stamp(m) // 10**8) % 1000
            wrong = np.eye(4)
            wrong[:2, 3] = 0.05 * number, -0.03 * number
            other = changed(other, **transform(_stamp(m), "odom", "base_link", wrong))
        if m.topic != COLOUR or _stamp(m) // 10**8 % 5:  # fewer images
            out.append(other)
    return out


def second_camera(topic: str, frame: str, *, more: int = 1) -> Change:
    """Another camera, whose frame nothing moves; it has `more` images for each of the first."""

    def change(messages: Messages) -> Messages:
        out = Messages()
        for m in messages:
            out.append(m)
            if m.topic in (COLOUR, DEPTH, INFO, DEPTH_INFO):
                for k in range(more):
                    copy = framed(stamped(m, _stamp(m) + k * 10**7), frame)
                    copy = replace(copy, topic=m.topic.replace("/camera", topic), time=m.time + k)
                    out.append(copy)
        return out

    return change


def upside_down(messages: Messages) -> Messages:
    """A camera mounted upside down, as tf says."""
    turned = np.diag([-1.0, -1.0, 1.0, 1.0])

    def change(m: Message) -> Message:
        if m.type == IMAGE:
            f = m.fields
            size = 2 if m.topic == DEPTH else 3
            array = np.asarray(f["data"]).reshape(f["height"], f["width"], size)[::-1, ::-1]
            return changed(m, data=np.ascontiguousarray(array).ravel())
        if m.type == CAMERA_INFO:
            K = np.array(m.fields["k"]).reshape(3, 3).copy()
            K[0, 2], K[1, 2] = m.fields["width"] - 1 - K[0, 2], m.fields["height"] - 1 - K[1, 2]
            return changed(m, k=K.ravel(), p=np.hstack([K, np.zeros((3, 1))]).ravel())
        if m.topic == STATIC and m.fields["transforms"][0]["child_frame_id"] == OPTICAL:
            at = _stamp(m)
            return changed(m, **transform(at, "camera_link", OPTICAL, BODY_FROM_CAMERA @ turned))
        return m

    return [change(m) for m in messages]


def unstamped(*topics: str) -> Change:
    """Headers without a stamp."""
    return lambda messages: [stamped(m, 0) if m.topic in topics else m for m in messages]


def restarted(messages: Messages) -> Messages:
    """A simulation that is started again: header stamps begin anew, recording times go on."""
    middle = sorted(m.time for m in messages)[len(messages) // 2]
    first = min(m.time for m in messages)
    return [
        stamped(m, _stamp(m) - first + 10**9) if m.time < middle else
        stamped(m, _stamp(m) - middle + 10**9)
        for m in messages
    ]  # fmt: skip


def thinned(share: int, *topics: str) -> Change:
    """Topics of which every so many messages are left."""

    def change(messages: Messages) -> Messages:
        seen = Counter[str]()
        left = Messages()
        for m in messages:
            seen[m.topic] += m.topic in topics
            if seen[m.topic] % share == 0 or m.topic not in topics:
                left.append(m)
        return left

    return change


def twice(messages: Messages) -> Messages:
    """Each message recorded twice, as by two recorders."""
    return [m for message in messages for m in (message, message)]


def shuffled(messages: Messages) -> Messages:
    """Messages that came up to 0.2 s late, and are stored as they came."""
    random = np.random.default_rng(7)
    late = [replace(m, time=m.time + int(random.integers(200_000_000))) for m in messages]
    return sorted(late, key=lambda m: m.time)


def half_calibrated(*topics: str) -> Change:
    """A CameraInfo of images half as large."""

    def change(m: Message) -> Message:
        if m.topic not in topics:
            return m
        f, half = m.fields, np.diag([0.5, 0.5, 1.0])
        K = (half @ np.array(f["k"]).reshape(3, 3)).ravel()
        return changed(m, k=K, width=f["width"] // 2, height=f["height"] // 2)

    return lambda messages: [change(m) for m in messages]


def without_pixels(topic: str) -> Change:
    """Every fifth image without any pixel, as a driver sends where a transfer fails."""

    def change(messages: Messages) -> Messages:
        ours = [m for m in messages if m.topic == topic]
        empty = {id(m) for m in ours[4::5]}
        none = np.zeros(0, np.uint8)
        return [
            changed(m, data=none, height=0, width=0, step=0) if id(m) in empty else m
            for m in messages
        ]

    return change
