"""Files of strangers for the commands that read files, each with the command that reads it."""

import gzip
import os
import sqlite3
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from kg.model.records import MapUpdate, PlaceRecord
from kg.serving.opening import create_map

Words = list[str]
DEEP: Final = 200_000  # levels
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


def _chained(folder: Path, links: int) -> str:
    """A bag with a chain of frames of tf, an image and its camera."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    from perception.sources.ros.message_maker import MessageMaker
    from perception.sources.ros.message_types import message_types

    make, types, eye = MessageMaker(is_ros1=False), message_types(is_ros1=False), np.eye(4)
    header, camera = make.header(10**9, f"f{links}"), "/camera/color/camera_info"
    chain = [make.transforms(10**9, f"f{n}", f"f{n + 1}", eye).transforms[0] for n in range(links)]
    matrix = np.array([500, 0, 320, 0, 500, 240, 0, 0, 1.0])
    sent = {
        "/tf": make.make("tf2_msgs/msg/TFMessage", transforms=chain),
        "/camera/color/image_raw": make.image(np.full((480, 640, 3), 7, np.uint8), "rgb8", header),
        camera: make.make(
            "sensor_msgs/msg/CameraInfo", header=header, height=480, width=640, k=matrix
        ),
        "/camera/aligned_depth_to_color/image_raw": make.image(
            np.full((480, 640), 1799, np.uint16), "16UC1", header
        ),
    }
    path = folder / "bag"
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for topic, message in sent.items():
            kind = message.__msgtype__
            line = bag.add_connection(topic, kind, typestore=types)
            bag.write(line, 10**9, types.serialize_cdr(message, kind))
    return str(path)


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
        file, f"CREATE VIEW meta AS {_ENDLESS_VIEW} SELECT i AS name, 1 AS value FROM n WHERE i < 0"
    )
    return path


def _with_places(f: Path, places: str) -> Words:
    return _maps(f, _good(f), "--places", places)


def _saved(f: Path, objects: str) -> Words:
    return ["thesis", "import", "--objects", objects, "--into", _map(f)]


def _conceptnet(f: Path, source: str) -> Words:
    return ["import", "conceptnet", "--from", source, "--into", str(f / "out.ttl")]


#: name -> the files in a folder, and the command that reads them
HOSTILE: Final[dict[str, Callable[[Path], Words]]] = {
    "endless poses": lambda f: _maps(f, _good(f), "--poses", _endless(f / "poses.txt")),
    "poses from a pipe": lambda f: _maps(f, _good(f), "--poses", _pipe(f / "poses.txt")),
    "64 GB of poses": lambda f: _maps(f, _good(f), "--poses", _sparse(f / "poses.txt")),
    "endless intrinsics": lambda f: _maps(f, _good(f), "--intrinsics", _endless(f / "k.json")),
    "endless places": lambda f: _with_places(f, _endless(f / "rooms.json")),
    "deep places": lambda f: _with_places(f, _written(f / "rooms.json", '{"a":' * DEEP)),
    "an array of a terabyte": lambda f: _with_places(f, _array(f)),
    "endless labels": lambda f: _maps(f, _good(f), "--labels-map", _endless(f / "labels.csv")),
    "endless transforms": lambda f: _maps(f, _good(f), "--transform", _endless(f / "t.json")),
    "endless detections": lambda f: _maps(f, _good(f), "--detector", _endless(f / "d.json")),
    "an endless network": lambda f: _maps(f, _good(f), "--detector", _endless(f / "d.onnx")),
    "an endless image": lambda f: _maps(f, _endless_image(f)),
    "an image bomb": lambda f: _maps(f, _recording(f, png(11_000, 11_000, bytes(11_000 * 33_001)))),
    "3,000 chained frames": lambda f: _maps(f, _chained(f, 3000)),
    "an endless view in a bag": lambda f: ["info", _endless_bag(f)],
    "a column of 2 GB in a bag": lambda f: ["info", _wide_bag(f)],
    "a chunk of an exabyte": lambda f: ["info", _mcap(f)],
    "an endless bag to convert": lambda f: ["convert", _endless(f / "a.bag"), "-o", f"{f}/b.mcap"],
    "an endless ontology": lambda f: ["ontology", "check", _endless(f / "a.ttl")],
    "a deep ontology": lambda f: ["ontology", "check", _written(f / "a.ttl", "[ <urn:a> " * DEEP)],
    "deep XML": lambda f: ["ontology", "check", _written(f / "a.owl", "<a>" * DEEP)],
    "an endless catalog": lambda f: ["ontology", "check", _catalogue(f)],
    "endless saved objects": lambda f: _saved(f, _endless(f / "o.json")),
    "deep saved objects": lambda f: _saved(f, _written(f / "o.json", "[" * DEEP)),
    "endless statistics": lambda f: ["import", "rooms", _endless(f / "r.csv"), "--into", _map(f)],
    "a gzip bomb": lambda f: _conceptnet(f, _written(f / "c.gz", gzip.compress(bytes(1 << 28)))),
    "an endless query": lambda f: ["ask", _map(f), _endless(f / "q.rq")],
    "an endless update": lambda f: ["update", _map(f), _endless(f / "u.ru")],
    "an endless history": lambda f: ["log", _history(f), "object/1"],
    "a place taught by an endless image": lambda f: _teach(f),
    "ontologies to check without end": lambda f: ["check", "--ontologies", _ontologies(f)],
}


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
