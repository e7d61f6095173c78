"""Surfaces in files, OBJ, STL and GLB, as points and triangles; see `assets` for their names."""

from __future__ import annotations

import struct
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

MAX_TRIANGLES = 1_000_000
_HEADER, _TRIANGLE = 84, 50


def load_mesh(name: str) -> Surface:
    """The surface of an asset; see the module. Raises BodiesError for what is none."""
    where = f"mesh {name!r}"
    return read_mesh(where, *read_asset(where, name))


def read_mesh(where: str, file: str, data: bytes) -> Surface:
    """The surface of a file with these contents. Raises BodiesError that begin with `where`."""
    read = _READERS.get(Path(file).suffix.lower())
    if read is None:
        raise BodiesError(f"{where}: expected a file of the type {', '.join(_READERS)}")
    points, triangles = read(where, data)
    if not len(triangles) or len(triangles) > MAX_TRIANGLES:
        raise BodiesError(f"{where}: {len(triangles)} triangles; expected 1 to {MAX_TRIANGLES}")
    if not np.isfinite(points).all() or not (np.abs(points) < 1e6).all():
        raise BodiesError(f"{where}: a coordinate is not a number below 1e6")
    if triangles.max() >= len(points):
        raise BodiesError(f"{where}: a triangle has point {triangles.max() + 1} of {len(points)}")
    return points, triangles


def check_closed(name: str, surface: Surface) -> None:
    """Raises BodiesError for a surface with a border, which has no inside."""
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


def _obj(where: str, data: bytes) -> Surface:
    points, triangles = list[list[float]](), list[tuple[int, int, int]]()
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        kind, *words = line.split("#")[0].split() or ("",)
        try:
            if kind == "v":
                x, y, z = map(float, words[:3])
                points.append([x, y, z])
            elif kind == "f":
                corners = [int(word.split("/")[0]) for word in words]
                corners = [at - 1 if at > 0 else len(points) + at for at in corners]
                if len(corners) < 3 or min(corners) < 0:
                    raise ValueError("a face has three points or more, counted from 1")
                triangles += [(corners[0], a, b) for a, b in pairwise(corners[1:])]
        except ValueError as error:
            raise BodiesError(f"{where}, line {number}: {line[:40]!r}: {error}") from None
    return np.array(points).reshape(-1, 3), np.array(triangles, np.uint32).reshape(-1, 3)


def _stl(where: str, data: bytes) -> Surface:
    count = struct.unpack_from("<I", data, _HEADER - 4)[0] if len(data) >= _HEADER else -1
    if len(data) == _HEADER + _TRIANGLE * count:
        layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(data, layout, count, _HEADER)["corners"].reshape(-1, 3)
    else:
        rows = [line.split() for line in data.decode("utf-8", "replace").splitlines()]
        words = [row[1:4] for row in rows if row[:1] == ["vertex"]]
        try:
            corners = np.array([[float(word) for word in row] for row in words]).reshape(-1, 3)
        except ValueError as error:
            raise BodiesError(f"{where}: a vertex of the STL file: {error}") from None
        if not data.lstrip().startswith(b"solid") or not len(corners) or len(corners) % 3:
            raise BodiesError(f"{where}: no STL file: its size does not fit its triangles")
    points, at = np.unique(corners.astype(np.float64), axis=0, return_inverse=True)
    return points, at.reshape(-1, 3).astype(np.uint32)


def _glb(where: str, data: bytes) -> Surface:
    """All meshes of the scene, in their places; y points up in glTF."""
    require("bodies", "trimesh", "trimesh", "space")
    import trimesh

    try:
        # Without a resolver: a GLB file has all its data inside.
        library: Any = trimesh
        mesh = library.load_scene(BytesIO(data), file_type="glb", process=False).to_mesh()
        x, y, z = np.asarray(mesh.vertices, np.float64).reshape(-1, 3).T
        return np.column_stack((x, -z, y)), np.asarray(mesh.faces).reshape(-1, 3).astype(np.uint32)
    except Exception as error:  # The library raises whatever its parts raise.
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise BodiesError(f"{where}: no GLB file: {why:.200}") from None


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
