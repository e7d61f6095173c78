"""Rigid poses and forms, without physics."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bodies import Box, Command, Joint, Matter, Rigid
from minerva_bodies.errors import BodiesError

angles = st.floats(-720, 720)
metres = st.floats(-100, 100)
poses = st.builds(Rigid.euler, metres, metres, metres, angles, angles, angles)


@given(poses, poses, poses)
def test_poses_are_a_group(a, b, c):
    left, right = a.then(b).then(c), a.then(b.then(c))
    assert left.numbers[:3] == pytest.approx(right.numbers[:3], abs=1e-9)
    dots = sum(p * q for p, q in zip(left.numbers[3:], right.numbers[3:], strict=True))
    assert abs(dots) == pytest.approx(1.0)
    assert a.then(a.inverse()).numbers[:3] == pytest.approx((0, 0, 0), abs=1e-9)


@given(metres, metres, angles)
def test_on_the_ground_they_are_those_of_the_plane(x, y, turn):
    turned = Rigid.euler(1.0, 2.0, 0.0, turn).then(Rigid(x, y))
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    plane = (1.0 + x * cos - y * sin, 2.0 + x * sin + y * cos, 0.0)
    assert turned.numbers[:3] == pytest.approx(plane, abs=1e-9)


def test_a_pitch_lowers_the_nose_and_bits_are_these():
    """Golden bits: the same on every processor."""
    nose = Rigid.euler(0, 0, 0, turn=90, pitch=30).then(Rigid(1))
    assert nose.numbers[:3] == pytest.approx((0, math.cos(math.pi / 6), -0.5))
    made = Rigid.euler(0.1, 0.2, 0.3, 40, 50, 60).then(Rigid.euler(1, 2, 3, 70, 80, 90))
    assert [number.hex() for number in made.numbers] == GOLDEN


GOLDEN = [
    "0x1.c2153997b4d22p+1",
    "0x1.f5fdeab3ca8d2p-1",
    "0x1.9c89ce9fcba43p+0",
    "0x1.6e89357e1eb80p-3",
    "0x1.2044820f4b198p-2",
    "0x1.df2b9eee35d93p-1",
    "0x1.d04d80f856962p-4",
]


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Matter(density=0), "without mass"),
        (lambda: Matter(restitution=2), "restitution from 0 to 1"),
        (lambda: Matter(group=32), "a group from -1 to 31"),
        (lambda: Box(1, 0, 1), "a size is 0"),
        (lambda: Box(1, math.nan, 1), "a size is nan"),
        (lambda: Command("shove", 0, 0, 0), "expected one of force"),
        (lambda: Joint("glue", "a", "b"), "expected one of fixed"),
        (lambda: Rigid.quaternion(0, 0, 0, 0, 0, 0, 0), "no length"),
    ],
)
def test_what_no_space_can_have_is_an_error(make, says):
    with pytest.raises(BodiesError, match=says):
        make()
