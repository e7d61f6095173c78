"""Surfaces in files: OBJ and STL, as points and triangles."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bodies.errors import BodiesError

Surface: TypeAlias = tuple[NDArray[np.float64], NDArray[np.uint32]]
"""Points (n, 3) in metres, and triangles (m, 3), counter-clockwise as seen from outside."""

MAX_BYTES = 64 << 20
MAX_TRIANGLES = 1_000_000
_HEADER, _TRIANGLE = 84, 50


def load_mesh(folder: Path, file: str) -> Surface:
    """The points (n, 3) and triangles (m, 3) of a file below a folder.

    Raises BodiesError for a file that is missing, elsewhere, too large, or no mesh.
    """
    path = (folder / file).resolve()
    where = f"mesh {file!r}"
    if not path.is_relative_to(folder.resolve()):
        raise BodiesError(f"{where}: expected a file below {folder}")
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BodiesError(f"{where}: {size} bytes; expected at most {MAX_BYTES}")
        data = path.read_bytes()
    except OSError as error:
        raise BodiesError(f"{where}: {error.strerror} ({path})") from None
    read = {".obj": _obj, ".stl": _stl}.get(path.suffix.lower())
    if read is None:
        raise BodiesError(f"{where}: expected a file of the type .obj or .stl")
    points, triangles = read(where, data)
    if not len(triangles) or len(triangles) > MAX_TRIANGLES:
        raise BodiesError(f"{where}: {len(triangles)} triangles; expected 1 to {MAX_TRIANGLES}")
    if not np.isfinite(points).all() or not (np.abs(points) < 1e6).all():
        raise BodiesError(f"{where}: a coordinate is not a number below 1e6")
    if triangles.max() >= len(points):
        raise BodiesError(f"{where}: a triangle has point {triangles.max() + 1} of {len(points)}")
    return points, triangles


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
    if len(data) != _HEADER + _TRIANGLE * count:
        raise BodiesError(f"{where}: no binary STL file: its size does not fit its triangles")
    layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    corners = np.frombuffer(data, layout, count, _HEADER)["corners"].reshape(-1, 3)
    points, at = np.unique(corners.astype(np.float64), axis=0, return_inverse=True)
    return points, at.reshape(-1, 3).astype(np.uint32)


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
