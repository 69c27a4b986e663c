"""PLY and glTF files of a scene: the surface as coloured points, objects as boxes with names.

PLY is for MeshLab, CloudCompare and Open3D: boxes are points along their edges, names are comments
of the header. glTF 2.0 (binary, .glb) is for Blender and browsers: boxes are meshes, and each is a
node with the object's name. glTF has y upwards, so that a root node turns the map's z there.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hereabouts.display.viewers.scene import Scene, SceneObject
from hereabouts.display.viewers.viewer import MARKER, heading_quaternion

_SPACING: Final = 0.01  # [m] between points along an edge
_Z_UP: Final = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]  # by columns
_FLOAT, _USHORT, _UBYTE = 5126, 5123, 5121  # component types
_POINTS, _TRIANGLES = 0, 4  # modes of primitives
_SIDES: Final = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def scene_as_ply(scene: Scene) -> bytes:
    """A binary PLY file in metres of the map frame."""
    points, colours = [scene.surface.points], [scene.surface.colours]
    comments = [f"comment {scene.title}"]
    for thing in scene.objects:
        edges = _edges(thing)
        points.append(edges)
        colours.append(np.tile(_bytes(thing), (len(edges), 1)))
        x, y, z = thing.p_map
        comments.append(f"comment {thing.name} {thing.text} at {x:g} {y:g} {z:g}")
    kind = np.dtype([("at", "<f4", (3,)), ("colour", "u1", (3,))])
    vertices = np.zeros(sum(map(len, points)), kind)
    vertices["at"], vertices["colour"] = np.concatenate(points), np.concatenate(colours)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(" ".join(line.split()).encode("ascii", "replace").decode() for line in comments),
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "end_header\n",
    ]
    return "\n".join(header).encode("ascii") + vertices.tobytes()


def scene_as_glb(scene: Scene) -> bytes:
    """A binary glTF file: a node "surface", and a node with the name of each object."""
    made = _Gltf()
    parts = []
    if len(scene.surface):
        colours = np.column_stack([scene.surface.colours, np.full(len(scene.surface), 255)])
        at = made.accessor(scene.surface.points, _FLOAT, "VEC3")
        colour = made.accessor(colours.astype(np.uint8), _UBYTE, "VEC4", normalized=True)
        attributes = {"POSITION": at, "COLOR_0": colour}
        parts.append(made.node("surface", made.mesh(attributes, mode=_POINTS)))
    if scene.objects:
        corners = np.array([*product((-0.5, 0.5), repeat=3)], np.float32)
        sides = np.array([[a, b, c, a, c, d] for a, b, c, d in _SIDES], np.uint16).ravel()
        at = made.accessor(corners, _FLOAT, "VEC3")
        indices = made.accessor(sides, _USHORT, "SCALAR")
        for thing in scene.objects:
            material = made.material(thing.group, [*thing.colour, 0.35])
            box = made.mesh({"POSITION": at}, indices=indices, material=material)
            name = f"{thing.text} ({thing.name})"
            placed = {"translation": list(thing.p_map), "scale": list(_sides(thing))}
            turn = list(heading_quaternion(thing.yaw))
            parts.append(made.node(name, box, **placed, rotation=turn))
    return made.file(made.node(scene.title, None, matrix=_Z_UP, children=parts))


class _Gltf:
    """A glTF document under construction, with its one buffer."""

    def __init__(self) -> None:
        self._parts: dict[str, list[dict[str, Any]]] = {}
        self._buffer = bytearray()
        self._materials: dict[str, int] = {}

    def _add(self, kind: str, **values: object) -> int:
        self._parts.setdefault(kind, []).append(values)
        return len(self._parts[kind]) - 1

    def accessor(self, values: NDArray[Any], component: int, kind: str, **more: object) -> int:
        """Accessor of an array (n, ...), which is appended to the buffer."""
        data = np.ascontiguousarray(values).tobytes()
        view = {"byteOffset": len(self._buffer), "byteLength": len(data)}
        self._buffer += data + bytes(-len(data) % 4)
        if component == _FLOAT:
            more |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        number = self._add("bufferViews", buffer=0, **view)
        shape = {"componentType": component, "type": kind, "count": len(values)}
        return self._add("accessors", bufferView=number, **shape, **more)

    def material(self, name: str, rgba: list[float]) -> int:
        """The material of a group of objects, made once."""
        if name not in self._materials:
            metal = {"baseColorFactor": rgba, "metallicFactor": 0}
            self._materials[name] = self._add(
                "materials",
                name=name,
                pbrMetallicRoughness=metal,
                alphaMode="BLEND",
                doubleSided=True,
            )
        return self._materials[name]

    def mesh(self, attributes: dict[str, int], **primitive: int) -> int:
        """A mesh of one primitive."""
        return self._add("meshes", primitives=[{"attributes": attributes, **primitive}])

    def node(self, name: str, mesh: int | None, **more: object) -> int:
        """A node with a name."""
        shown = {} if mesh is None else {"mesh": mesh}
        return self._add("nodes", name=name, **shown, **{k: v for k, v in more.items() if v})

    def file(self, root: int) -> bytes:
        """The binary file of the scene below a node."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "hereabouts"},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
            **self._parts,
        }
        if self._buffer:
            document["buffers"] = [{"byteLength": len(self._buffer)}]
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        chunks = [len(text).to_bytes(4, "little"), b"JSON", text]
        if self._buffer:
            chunks += [len(self._buffer).to_bytes(4, "little"), b"BIN\0", bytes(self._buffer)]
        length = 12 + sum(map(len, chunks))
        header = b"glTF" + (2).to_bytes(4, "little") + length.to_bytes(4, "little")
        return b"".join([header, *chunks])


def _sides(thing: SceneObject) -> tuple[float, float, float]:
    """[m] of the box, or of a marker where the extent is unknown."""
    return thing.extent or (MARKER, MARKER, MARKER)


def _bytes(thing: SceneObject) -> NDArray[np.uint8]:
    return np.round(255 * np.array(thing.colour)).astype(np.uint8)


def _edges(thing: SceneObject) -> NDArray[np.float32]:
    """Points (n, 3) [m] along the 12 edges of an object's box."""
    edges = np.concatenate([*_edges_of(np.array(_sides(thing)) / 2)])
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    turned = edges @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)])
    return np.asarray(np.array(thing.p_map) + turned, "<f4")


def _edges_of(half: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    for axis in range(3):
        along = np.linspace(-half[axis], half[axis], max(2, int(2 * half[axis] / _SPACING) + 1))
        others = [a for a in range(3) if a != axis]
        for signs in product((-1.0, 1.0), repeat=2):
            edge = np.zeros((len(along), 3))
            edge[:, axis] = along
            edge[:, others] = np.array(signs) * half[others]
            yield edge
