"""Flat matrices of a picture as Foxglove's grids."""

from __future__ import annotations

from typing import Final

from foxglove.messages import (
    Grid,
    PackedElementField,
    PackedElementFieldNumericType,
    Pose,
    Quaternion,
    Timestamp,
    Vector2,
    Vector3,
)

from minerva_services.views.floor_parts import Floor, pixels
from minerva_services.views.foxglove.entities import GROUND
from minerva_services.views.solids import upright

_FIELDS: Final = [
    PackedElementField(name=name, offset=place, type=PackedElementFieldNumericType.Uint8)
    for place, name in enumerate(("red", "green", "blue", "alpha"))
]


def grid(floor: Floor, stamp: Timestamp) -> Grid:
    """A matrix as an image on the ground; its rows extend along x, as a grid's columns do."""
    tiles = floor.tiles
    columns = tiles.cells.shape[0]
    w, x, y, z = upright(tiles.pose.angle).tolist()
    return Grid(
        timestamp=stamp,
        frame_id=GROUND,
        pose=Pose(
            position=Vector3(x=tiles.pose.x, y=tiles.pose.y, z=floor.height),
            orientation=Quaternion(x=x, y=y, z=z, w=w),
        ),
        column_count=columns,
        cell_size=Vector2(x=tiles.cell, y=tiles.cell),
        row_stride=4 * columns,
        cell_stride=4,
        fields=_FIELDS,
        data=pixels(tiles).tobytes(),
    )
