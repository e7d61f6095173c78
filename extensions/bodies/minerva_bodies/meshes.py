"""Surfaces in files, OBJ, STL and GLB, as points and triangles; see `assets` for their names."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bodies.assets import read_asset
from minerva_bodies.errors import BodiesError
from minerva_services.options import require

Surface: TypeAlias = tuple[NDArray[np.float64], NDArray[np.uint32]]
"""Points (n, 3) in metres, and triangles (m, 3), counter-clockwise as seen from outside."""

MAX_TRIANGLES, MAX_COORDINATE = 1_000_000, 1e6
_HEADER, _TRIANGLE, _FLAT = 84, 50, 1e-12


def load_mesh(name: str) -> Surface:
    """The surface of an asset; see the module. Raises BodiesError for what is none."""
    where = f"mesh {name!r:.200}"
    return read_mesh(where, *read_asset(where, name))


def read_mesh(where: str, file: str, data: bytes) -> Surface:
    """The surface of a file with these contents. Raises BodiesError that begin with `where`."""
    read = _READERS.get(Path(file).suffix.lower())
    if read is None:
        raise BodiesError(f"{where}: expected a file of the type {', '.join(_READERS)}")
    points, triangles = read(where, data)
    if not len(triangles) or len(triangles) > MAX_TRIANGLES:
        raise BodiesError(f"{where}: {len(triangles)} triangles; expected 1 to {MAX_TRIANGLES}")
    if not (np.abs(points) < MAX_COORDINATE).all():  # No comparison with NaN is true.
        raise BodiesError(f"{where}: a coordinate is not a number below 1e6")
    if triangles.max() >= len(points):
        raise BodiesError(f"{where}: a triangle has point {triangles.max() + 1} of {len(points)}")
    return points, triangles


def check_closed(name: str, surface: Surface) -> None:
    """Raises BodiesError for a surface with a border, or of one plane, which has no inside."""
    points, triangles = surface
    _, same = np.unique(points.round(9), axis=0, return_inverse=True)
    corners = same.ravel()[triangles]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    if opened := int((count == 1).sum()):
        raise BodiesError(
            f"mesh {name!r}: it is open: {opened} of {len(count)} edges have one triangle; a body"
            " that moves needs a closed surface"
        )
    least, _, largest = np.linalg.eigvalsh(np.cov(points.T))
    if not least > _FLAT * largest:
        raise BodiesError(f"mesh {name!r}: it is flat; a body that moves needs a volume")


def _obj(where: str, data: bytes) -> Surface:
    points, triangles = list[list[float]](), list[tuple[int, int, int]]()
    farthest = 0, 0, ""
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        kind, *words = line.split("#")[0].split() or ("",)
        try:
            if kind == "v":
                points.append(_point(words[:3]))
            elif kind == "f":
                corners = [int(word.split("/")[0]) for word in words]
                corners = [at if at > 0 else len(points) + at + 1 for at in corners]
                if len(corners) < 3 or min(corners) < 1:
                    raise ValueError("a face has three points or more, counted from 1")
                farthest = max(farthest, (max(corners), number, line))
                triangles += [(corners[0] - 1, a - 1, b - 1) for a, b in pairwise(corners[1:])]
        except ValueError as error:
            raise _wrong(where, number, line, error) from None
    last, number, line = farthest
    if last > len(points):
        raise _wrong(where, number, line, f"the file has {len(points)} points")
    return np.array(points).reshape(-1, 3), np.array(triangles, np.uint32).reshape(-1, 3)


def _point(words: Sequence[str]) -> list[float]:
    """The numbers of a point. Raises ValueError."""
    point = [float(word) for word in words]
    if len(point) != 3 or not all(abs(number) < MAX_COORDINATE for number in point):
        raise ValueError("expected three numbers below 1e6")
    return point


def _wrong(where: str, number: int, line: str, why: object) -> BodiesError:
    return BodiesError(f"{where}, line {number}: {line.strip()[:40]!r}: {why}")


def _stl(where: str, data: bytes) -> Surface:
    count = struct.unpack_from("<I", data, _HEADER - 4)[0] if len(data) >= _HEADER else -1
    if len(data) == _HEADER + _TRIANGLE * count:
        layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(data, layout, count, _HEADER)["corners"].reshape(-1, 3)
    else:
        vertices = list[list[float]]()
        for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
            kind, *words = line.split() or ("",)
            if kind == "vertex":
                try:
                    vertices.append(_point(words))
                except ValueError as error:
                    raise _wrong(where, number, line, error) from None
        if not data.lstrip().startswith(b"solid") or not vertices or len(vertices) % 3:
            raise BodiesError(f"{where}: no STL file: its size does not fit its triangles")
        corners = np.array(vertices)
    points, at = np.unique(corners.astype(np.float64), axis=0, return_inverse=True)
    return points, at.reshape(-1, 3).astype(np.uint32)


def _glb(where: str, data: bytes) -> Surface:
    """All meshes of the scene, in their places; y points up in glTF."""
    require("bodies", "trimesh", "trimesh", "space")
    import trimesh

    try:
        _check_glb(data)
        # Without a resolver: a GLB file has all its data inside.
        library: Any = trimesh
        scene = library.load_scene(
            BytesIO(data), file_type="glb", process=False, skip_materials=True
        )
        mesh = scene.to_mesh()
        x, y, z = np.asarray(mesh.vertices, np.float64).reshape(-1, 3).T
        return np.column_stack((x, -z, y)), np.asarray(mesh.faces).reshape(-1, 3).astype(np.uint32)
    except BodiesError as error:
        raise BodiesError(f"{where}: {error}") from None
    except Exception as error:  # The library raises whatever its parts raise.
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise BodiesError(f"{where}: no GLB file: {why:.200}") from None


def _check_glb(data: bytes) -> None:
    """Raises BodiesError for what the library would take for less, more or endless."""
    magic, _, _, size = struct.unpack_from("<4s3I", data.ljust(20))
    if magic != b"glTF":
        raise BodiesError("no GLB file: it does not begin with glTF")
    scene: Any = json.loads(data[20 : 20 + size])
    for buffer in scene.get("buffers", ()):
        if not buffer.get("uri", "data:").startswith("data:"):
            file = f"{buffer['uri']!r:.60}"
            raise BodiesError(f"its data are in another file, {file}; put all into the GLB file")
    # Others concern materials.
    needed = [name for name in scene.get("extensionsRequired", ()) if "mesh" in name]
    if needed:
        raise BodiesError(f"its meshes are compressed by {needed[0]:.60}; expected plain ones")
    nodes = scene.get("nodes", [])
    inner = [child for node in nodes for child in node.get("children", ())]
    roots = [root for each in scene.get("scenes", ()) for root in dict.fromkeys(each["nodes"])]
    if len({*inner}) < len(inner) or not {*inner}.isdisjoint(roots):
        raise BodiesError("a node of its scene has two parents; expected a tree")
    counts: list[int] = [abs(each["count"]) for each in scene.get("accessors", ())]
    # Each mesh is read once, and copied for each node that shows it.
    meshes = [0] * len(scene.get("meshes", ()))
    for number, mesh in enumerate(scene.get("meshes", ())):
        for part in mesh["primitives"]:
            meshes[number] += counts[part.get("indices", part["attributes"]["POSITION"])]
    shown = sum(meshes[int(node["mesh"])] for node in nodes if "mesh" in node)
    if max(sum(counts) / 4, sum(meshes), shown) > 3 * MAX_TRIANGLES:
        raise BodiesError(f"its scene has more than {MAX_TRIANGLES} triangles")


_READERS: Final = {".obj": _obj, ".stl": _stl, ".glb": _glb}


def ground(heights: ArrayLike, cell: float) -> Surface:
    """The ground of a matrix of heights in centimetres. Raises BodiesError for less than a cell."""
    z = np.array(heights, np.float64) / 100.0
    rows, columns = z.shape
    if rows < 2 or columns < 2:
        raise BodiesError(f"terrain: {rows} x {columns} heights; expected 2 x 2 or more")
    row, column = np.indices(z.shape)
    points: NDArray[np.float64] = np.column_stack(
        (row.ravel() * cell, column.ravel() * cell, z.ravel())
    ).astype(np.float64)
    first = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = first[:-1, :-1], first[1:, :-1], first[1:, 1:], first[:-1, 1:]
    below = np.stack((a, b, c), axis=-1).reshape(-1, 3)
    above = np.stack((a, c, d), axis=-1).reshape(-1, 3)
    return points, np.concatenate((below, above))
