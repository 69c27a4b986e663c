"""Family of attacks: folders of maps and recordings that strangers made, given to commands."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path
from typing import Final

from benchmarks.attack.commands import outcome_of
from benchmarks.attack.outcome import Outcome
from benchmarks.attack.target import Target
from kg.history.storage.log import SCHEMA
from kg.serving.opening import create_map

ATTEMPTS: Final = 24
_ASKING: Final = (
    ["ask", "MAP", "objects"], ["ask", "MAP", "objects", "--at", "#0"], ["check", "MAP"],
    ["log", "MAP", "object/1"], ["rooms", "MAP"], ["why", "MAP", "object/1"],
    ["status", "MAP", "cup"],
    ["find", "MAP", "cup", "--from", "0,0"], ["compact", "MAP", "--keep", "1h"],
    ["export", "MAP", "-o", "OUT"], ["diff", "MAP", "#0", "#1"],
)  # fmt: skip
_ENDLESS: Final = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT"
_NUMBERS: Final = ("9" * 400, "1e400", "-1e308", "NaN", "1" + "0" * 5000, "1e-400", "0x10", "1_0")


def attack(target: Target) -> Outcome:
    """Damage drawn from the seed, to a small map or recording, then a command drawn from it."""
    rng, total = target.rng, Outcome()
    good, house = target.folder / "good.map", target.folder / "house"
    create_map(good).close()
    words = ["simulate", "house", "--seed", "3", "--size", "80x60", "-o", str(house)]
    outcome_of(words)
    for number in range(ATTEMPTS):
        if rng.random() < 0.5:
            total += _map(target.folder / f"{number}.map", good, rng)
        else:
            total += _recording(target.folder / f"house-{number}", house, rng)
    return total


def _map(path: Path, good: Path, rng: random.Random) -> Outcome:
    shutil.copytree(good, path)
    rng.choice((_views, _views, _bomb, _special, _flipped))(path / "history.sqlite", rng)
    if rng.random() < 0.3:
        chosen = rng.choice(sorted(path.glob("store/*")))
        rng.choice((_special, _flipped))(chosen, rng)
    places = {"MAP": str(path), "OUT": str(path.with_suffix(".trig"))}
    return outcome_of([places.get(word, word) for word in rng.choice(_ASKING)])


def _recording(path: Path, house: Path, rng: random.Random) -> Outcome:
    shutil.copytree(house, path)
    images = [*sorted(path.glob("rgb/*"))[:3], *sorted(path.glob("depth/*"))[:3]]
    texts = [*path.glob("*.txt"), *path.glob("*.json")]
    chosen = rng.choice((rng.choice(images), rng.choice(texts), rng.choice(texts)))
    if chosen in images:
        rng.choice((_special, _flipped, _image_bomb))(chosen, rng)
    else:
        rng.choice((_special, _flipped, _numbers, _numbers, _nested, _endless_line))(chosen, rng)
    words = ["map", str(path), "--into", str(path.with_suffix(".map")), "--limit", "5"]
    words += ["--detector", str(path / "detections.json"), "--places", str(path / "places.json")]
    if rng.random() < 0.2:
        words += ["--poses", rng.choice(("/dev/zero", "/dev/urandom", str(chosen)))]
    return outcome_of(words)


def _views(file: Path, rng: random.Random) -> None:
    """Tables of a history that are views over a recursion, or have triggers or other columns."""
    for part in file.parent.glob(file.name + "*"):
        part.unlink()
    with closing(sqlite3.connect(file)) as made:
        made.executescript(SCHEMA)
        tables = "SELECT name FROM sqlite_master WHERE sql LIKE 'CREATE TABLE%'"
        names = [row[0] for row in made.execute(tables)]
        name = rng.choice(names)
        columns = [row[1] for row in made.execute(f"PRAGMA table_info({name})")]
        if rng.random() < 0.7:
            made.execute(f"DROP TABLE {name}")
            given = ", ".join(f"x AS {column}" for column in columns)
            made.execute(f"CREATE VIEW {name} AS {_ENDLESS} {given} FROM n")
        else:
            made.execute(
                f"CREATE TRIGGER t AFTER INSERT ON {name} BEGIN INSERT INTO {name} "
                f"SELECT * FROM {name}; END"
            )
        made.commit()


def _bomb(file: Path, rng: random.Random) -> None:
    """Rows of a history that are gigabytes when they are unpacked."""
    bomb = zlib.compress(bytes(1 << 20)) * 3000 if rng.random() < 0.5 else _long(rng)
    with closing(sqlite3.connect(file)) as made:
        for table in ("state", "change", "background"):
            made.execute(f"UPDATE {table} SET data = ?", (bomb,))
        made.execute("INSERT OR REPLACE INTO change VALUES (1, ?)", (bomb,))
        made.execute("INSERT OR REPLACE INTO commits VALUES (1, 1e9, 'update', NULL, '')")
        made.commit()


def _long(rng: random.Random) -> bytes:
    packer = zlib.compressobj(9)
    parts = [packer.compress(bytes([rng.randrange(256)]) * (1 << 24)) for _ in range(300)]
    return b"".join([*parts, packer.flush()])


def _special(file: Path, rng: random.Random) -> None:
    """A pipe, an endless device, a loop of links, a folder, or nothing in place of the file."""
    file.unlink()
    kind = rng.randrange(5)
    if kind == 0:
        os.mkfifo(file)
    elif kind == 1:
        file.symlink_to(rng.choice(("/dev/zero", "/dev/urandom", "/dev/tty", "/proc/kmsg")))
    elif kind == 2:
        file.symlink_to(file)
    elif kind == 3:
        file.mkdir()
    else:
        file.write_bytes(b"")


def _flipped(file: Path, rng: random.Random) -> None:
    """Some bytes changed, or the end cut off."""
    data = bytearray(file.read_bytes())
    for _ in range(rng.choice((1, 8, 200))):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    file.write_bytes(data[: rng.choice((len(data), len(data) // 2))])


def _image_bomb(file: Path, rng: random.Random) -> None:
    """A PNG whose header promises 10 to 60 thousand pixels a side."""
    width, height = (rng.randint(10_000, 60_000) for _ in range(2))
    head = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    packed = zlib.compress(bytes(1 << 20))
    parts = [(b"IHDR", head), *[(b"IDAT", packed)] * 20, (b"IEND", b"")]
    chunks = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    ]
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))


def _numbers(file: Path, rng: random.Random) -> None:
    """Some numbers of a text become ones that few readers take."""
    words = file.read_text(encoding="utf-8").split(" ")
    bare = [word.strip("-,[]{}\n") for word in words]
    numeric = [k for k, word in enumerate(bare) if word.replace(".", "").isdigit()]
    for at in rng.sample(numeric, min(len(numeric), rng.choice((1, 5, 50)))):
        words[at] = words[at].replace(bare[at], rng.choice(_NUMBERS))
    file.write_text(" ".join(words), encoding="utf-8")


def _nested(file: Path, rng: random.Random) -> None:
    """Brackets in brackets."""
    depth = rng.choice((500, 5_000, 200_000))
    text = "[" * depth + "]" * depth if rng.random() < 0.5 else '{"a":' * depth + "1" + "}" * depth
    file.write_text(text, encoding="utf-8")


def _endless_line(file: Path, rng: random.Random) -> None:
    """One line of 100 MB, or a million short ones."""
    text = rng.choice(("1", "x", "1 ", '"')) * 100_000_000
    file.write_text(text if rng.random() < 0.5 else "1 2 3\n" * 1_000_000, encoding="utf-8")
