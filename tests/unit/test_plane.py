"""The plane: results of transformations, and the extent of a string."""

import numpy as np
import pytest

from minerva_bus import (
    Cells,
    Degrees,
    Disc,
    Label,
    Line,
    Metres,
    Motion,
    Primitive,
    Raster,
    Transformation,
    Vocabulary,
    interpret,
    parse,
)
from minerva_bus.errors import MisuseError
from minerva_bus.semantics.plane import PlaneGeometry, bounds, raster_corner
from minerva_bus.semantics.poses import Pose

PDisc = Primitive("PDisc", Disc("r"), r=Metres)
PWall = Primitive("PWall", Line("xs", "ys", width=0.2), xs="list of real m", ys="list of real m")
PMap = Primitive("PMap", Raster("cells", 0.5, x=1.0), cells=Cells)
PName = Primitive("PName", Label("name"), name=str)
PSound = Primitive("PSound")
TMove = Transformation("TMove", Motion(forward="dist"), dist=Metres)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=Degrees)
TFade = Transformation("TFade")
VOCABULARY = Vocabulary.of(PDisc, PWall, PMap, PName, PSound, TMove, TTurn, TFade)


def room(scene):
    box = bounds(scene, VOCABULARY)
    return box and tuple(round(x, 9) for x in (box.left, box.bottom, box.right, box.top))


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (PDisc(2), (-2, -2, 2, 2)),
        (TMove(3)(PDisc(1)), (2, -1, 4, 1)),
        (TTurn(90)(TMove(3)(PDisc(1))), (-1, 2, 1, 4)),
        (TMove(1)(TTurn(180)(TMove(3)(PDisc(1)))), (-3, -1, -1, 1)),
        (TFade()(TMove(1)(PDisc(1))), (0, -1, 2, 1)),
        (PDisc(1) + TMove(5)(PDisc(1)), (-1, -1, 6, 1)),
        (PWall([0, 4], [0, 2]), (-0.1, -0.1, 4.1, 2.1)),
        (PMap(np.zeros((4, 2), np.int16)), (1, 0, 3, 1)),
        (TTurn(90)(PMap(np.zeros((4, 2), np.int16))), (-1, 1, 0, 3)),
        (TMove(2)(PName("here")), (2, 0, 2, 0)),
        (PSound(), None),
    ],
    ids=str,
)
def test_bounds(scene, expected):
    assert room(scene) == expected


def test_a_pose_is_restored_after_every_scope():
    geometry = PlaneGeometry(VOCABULARY)
    interpret(TMove(1)(TTurn(90)(PDisc(1)) + TMove(1)()), geometry)
    assert geometry.pose == Pose()


def test_it_is_for_strings_without_agents():
    with pytest.raises(MisuseError, match="AFox#a"):
        bounds(parse("TMove<dist=1>(AFox#a)"), VOCABULARY)


def test_the_corner_of_a_raster_is_moved_and_turned():
    raster = Raster("cells", 0.5, x=1.0, y="up", turn=90.0)
    corner = raster_corner(raster, {"up": 2.0}, Pose(3.0, 4.0, 0.0))
    assert (corner.x, corner.y, corner.angle) == (4.0, 6.0, 90.0)
