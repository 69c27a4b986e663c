"""Files of strangers for the commands that read files, each with the command that reads it."""

from __future__ import annotations

import gzip
import os
import sqlite3
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import create_map

Words = list[str]
DEEP: Final = 200_000  # levels
LONG: Final = "9" * 400  # digits of a number
_ROOM: Final = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
    '"geometry": {"type": "Polygon", "coordinates": '
)
_ENDLESS_VIEW: Final = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"


def _written(path: Path, data: bytes | str) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return str(path)


def _endless(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to("/dev/zero")
    return str(path)


def _pipe(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    os.mkfifo(path)
    return str(path)


def _sparse(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.truncate(1 << 36)
    return str(path)


def _map(folder: Path) -> str:
    create_map(folder / "a.map").close()
    return str(folder / "a.map")


def png(width: int, height: int, rows: bytes = b"", depth: int = 8, colour: int = 2) -> bytes:
    """A PNG whose header names a size, with compressed `rows`."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def _recording(folder: Path, colour: bytes) -> str:
    """A recording of one frame in the layout of 7-Scenes."""
    home = folder / "recording"
    _written(home / "frame-000000.color.png", colour)
    _written(home / "frame-000000.depth.png", png(640, 480, bytes(480 * 1281), 16, 0))
    _written(home / "frame-000000.pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    return str(home)


def _good(folder: Path) -> str:
    return _recording(folder, png(640, 480, bytes(480 * 1921)))


def _maps(folder: Path, recording: str, *more: str) -> Words:
    return ["map", recording, "--into", str(folder / "new.map"), "--no-check", *more]


def _bag(path: Path, links: list[tuple[str, str]], messages: int = 1) -> str:
    """A bag with transforms of pairs of frames, an image and its camera."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds = types.types

    def made(name: str, **fields: object) -> Any:
        return kinds[name](**fields)

    def header(frame: str) -> Any:
        stamp = made("builtin_interfaces/msg/Time", sec=1, nanosec=0)
        return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    transform = made(
        "geometry_msgs/msg/Transform",
        translation=made("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0),
        rotation=made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    tf = made(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            made(
                "geometry_msgs/msg/TransformStamped",
                header=header(parent), child_frame_id=child, transform=transform,
            )
            for parent, child in links
        ],
    )  # fmt: skip
    frame = links[-1][1]

    def image(encoding: str, step: int) -> Any:
        data = np.full(480 * 640 * step, 7, np.uint8)
        return made(
            "sensor_msgs/msg/Image", header=header(frame), height=480, width=640,
            encoding=encoding, is_bigendian=0, step=640 * step, data=data,
        )  # fmt: skip

    matrix = np.array([500, 0, 320, 0, 500, 240, 0, 0, 1.0])
    info = made(
        "sensor_msgs/msg/CameraInfo", header=header(frame), height=480, width=640,
        distortion_model="plumb_bob", d=np.zeros(5), k=matrix, r=np.eye(3).ravel(),
        p=np.zeros(12), binning_x=0, binning_y=0,
        roi=made(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0,
            do_rectify=False,
        ),
    )  # fmt: skip
    topics = {
        "/tf": [tf] * messages,
        "/camera/color/image_raw": [image("rgb8", 3)],
        "/camera/color/camera_info": [info],
        "/camera/aligned_depth_to_color/image_raw": [image("16UC1", 2)],
    }
    plugin = StoragePlugin.SQLITE3
    with Writer(path, version=8, storage_plugin=plugin) as bag:
        for topic, sent in topics.items():
            kind = sent[0].__msgtype__
            line = bag.add_connection(topic, kind, typestore=types)
            for number, message in enumerate(sent):
                bag.write(line, 10**9 + number, types.serialize_cdr(message, kind))
    return str(path)


def _chained(folder: Path, links: int, messages: int = 1) -> str:
    return _bag(folder / "bag", [(f"f{i}", f"f{i + 1}") for i in range(links)], messages)


def _looped(folder: Path) -> str:
    return _bag(folder / "bag", [("a", "b"), ("b", "c"), ("c", "a")])


def _database(path: Path, *statements: str) -> str:
    with sqlite3.connect(path) as made:
        made.executescript(";".join(statements))
    made.close()
    return str(path)


def _endless_bag(folder: Path) -> str:
    return _database(
        folder / "bag.db3",
        "CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)",
        "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)",
        f"CREATE VIEW schema AS {_ENDLESS_VIEW} SELECT i AS schema_version FROM n WHERE i < 0",
    )


def _wide_bag(folder: Path) -> str:
    return _database(
        folder / "bag.db3",
        "CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)",
        "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER,"
        " size INTEGER, data BLOB AS (zeroblob(size)))",
        "INSERT INTO topics VALUES (1, '/tf', 'tf2_msgs/msg/TFMessage', 'cdr')",
        "INSERT INTO messages (id, topic_id, timestamp, size) VALUES (1, 1, 1, 999999999)",
    )


def _mcap(folder: Path) -> str:
    """An MCAP file whose only chunk says that it expands to an exabyte."""
    head = b"\x89MCAP0\r\n"
    text = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    chunk = struct.pack("<QQQI", 0, 1, 1 << 60, 0) + struct.pack("<I", 4) + b"zstd"
    chunk += struct.pack("<Q", 4) + b"abcd"
    records = b"".join(
        struct.pack("<BQ", kind, len(data)) + data for kind, data in ((1, text), (6, chunk))
    )
    foot = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
    return _written(folder / "a.mcap", head + records + foot + head)


def _array(folder: Path) -> str:
    with (folder / "floor.npy").open("wb") as file:
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
        np.lib.format.write_array_header_1_0(file, header)
    text = "image: floor.npy\nresolution: 0.05\norigin: [0, 0, 0]\nplaces: rooms.json\n"
    return _written(folder / "floor.yaml", text)


def _history(folder: Path) -> str:
    path = _map(folder)
    file = Path(path) / "history.sqlite"
    for old in Path(path).glob("history.sqlite*"):
        old.unlink()
    _database(
        file,
        f"CREATE VIEW meta AS {_ENDLESS_VIEW} SELECT i AS name, 1 AS value FROM n WHERE i < 0",
    )
    return path


def _report(folder: Path) -> str:
    path = _map(folder)
    _endless(Path(path) / "detections.json")
    return path


def _with_places(f: Path, places: str) -> Words:
    return _maps(f, _good(f), "--places", places)


#: name -> the files in a folder, and the command that reads them
HOSTILE: Final[dict[str, Callable[[Path], Words]]] = {
    "endless poses": lambda f: _maps(f, _good(f), "--poses", _endless(f / "poses.txt")),
    "poses from a pipe": lambda f: _maps(f, _good(f), "--poses", _pipe(f / "poses.txt")),
    "64 GB of poses": lambda f: _maps(f, _good(f), "--poses", _sparse(f / "poses.txt")),
    "endless intrinsics": lambda f: _maps(f, _good(f), "--intrinsics", _endless(f / "k.json")),
    "deep intrinsics": lambda f: _maps(
        f, _good(f), "--intrinsics", _written(f / "k.json", "[" * DEEP)
    ),
    "endless places": lambda f: _with_places(f, _endless(f / "rooms.json")),
    "deep places": lambda f: _with_places(f, _written(f / "rooms.json", '{"a":' * DEEP)),
    "a corner of 400 digits": lambda f: _with_places(
        f,
        _written(
            f / "rooms.geojson", f"{_ROOM}[[[{LONG}, 0], [1, 0], [1, 1], [{LONG}, 0]]]}}}}]}}"
        ),
    ),
    "an array of a terabyte": lambda f: _with_places(f, _array(f)),
    "endless labels": lambda f: _maps(f, _good(f), "--labels-map", _endless(f / "labels.csv")),
    "endless transforms": lambda f: _maps(
        f, _good(f), "--transform", _endless(f / "t.json"), "--sequence", "a"
    ),
    "endless detections": lambda f: _maps(f, _good(f), "--detector", _endless(f / "d.json")),
    "an endless network": lambda f: _maps(f, _good(f), "--detector", _endless(f / "d.onnx")),
    "an image of 100,000 x 100,000": lambda f: _maps(f, _recording(f, png(100_000, 100_000))),
    "an image that is a pipe": lambda f: _maps(f, _piped(f)),
    "an endless image": lambda f: _maps(f, _endless_image(f)),
    "an image bomb": lambda f: _maps(f, _recording(f, png(11_000, 11_000, bytes(11_000 * 33_001)))),
    "3,000 chained frames": lambda f: _maps(f, _chained(f, 3000)),
    "900 chained frames, 50 times": lambda f: _maps(f, _chained(f, 900, 50)),
    "frames in a loop": lambda f: _maps(f, _looped(f)),
    "an endless view in a bag": lambda f: ["info", _endless_bag(f)],
    "a column of 2 GB in a bag": lambda f: ["info", _wide_bag(f)],
    "a chunk of an exabyte": lambda f: ["info", _mcap(f)],
    "an endless bag": lambda f: ["info", _endless(f / "a.mcap")],
    "an endless bag to convert": lambda f: [
        "convert",
        _endless(f / "a.bag"),
        "-o",
        str(f / "b.mcap"),
    ],
    "an endless ontology": lambda f: ["ontology", "check", _endless(f / "a.ttl")],
    "a deep ontology": lambda f: ["ontology", "check", _written(f / "a.ttl", "[ <urn:a> " * DEEP)],
    "deep XML": lambda f: ["ontology", "check", _written(f / "a.owl", "<a>" * DEEP)],
    "an endless catalog": lambda f: ["ontology", "check", _catalogue(f)],
    "endless saved objects": lambda f: [
        "import",
        "reference-maps",
        "--objects",
        _endless(f / "o.json"),
        "--into",
        _map(f),
    ],
    "deep saved objects": lambda f: [
        "import",
        "reference-maps",
        "--objects",
        _written(f / "o.json", "[" * DEEP),
        "--into",
        _map(f),
    ],
    "endless statistics": lambda f: ["import", "rooms", _endless(f / "r.csv"), "--into", _map(f)],
    "a gzip bomb": lambda f: [
        "import",
        "conceptnet",
        "--from",
        _written(f / "c.gz", gzip.compress(bytes(1 << 28))),
        "--into",
        str(f / "out.ttl"),
    ],
    "an endless query": lambda f: ["ask", _map(f), _endless(f / "q.rq")],
    "an endless update": lambda f: ["update", _map(f), _endless(f / "u.ru")],
    "an endless history": lambda f: ["log", _history(f), "object/1"],
    "an endless history to check": lambda f: ["check", _history(f)],
    "a place taught by an endless image": lambda f: _teach(f),
    "ontologies to check without end": lambda f: ["check", "--ontologies", _ontologies(f)],
}


def _piped(folder: Path) -> str:
    home = Path(_good(folder))
    (home / "frame-000000.color.png").unlink()
    _pipe(home / "frame-000000.color.png")
    return str(home)


def _endless_image(folder: Path) -> str:
    home = Path(_good(folder))
    (home / "frame-000000.color.png").unlink()
    _endless(home / "frame-000000.color.png")
    return str(home)


def _catalogue(folder: Path) -> str:
    _endless(folder / "catalog-v001.xml")
    text = "<urn:a> a <http://www.w3.org/2002/07/owl#Ontology> ; "
    text += "<http://www.w3.org/2002/07/owl#imports> <urn:b> ."
    return _written(folder / "a.ttl", text)


def _ontologies(folder: Path) -> str:
    _endless(folder / "ontologies" / "a.ttl")
    return str(folder / "ontologies")


def _teach(folder: Path) -> Words:
    with create_map(folder / "a.map") as made:
        place = PlaceRecord(made.place_iri(1), "room", 0, 4, 0, 4)
        made.apply(MapUpdate(places=(place,)))
    _endless(folder / "images" / "1.png")
    path, images = str(folder / "a.map"), str(folder / "images")
    return ["teach", path, "place/1", "kitchen", "--images", images]
