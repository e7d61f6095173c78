"""Rigid poses in space: metres and a unit quaternion, with the same bits on every processor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bodies.errors import BodiesError
from minerva_bus import portable


@dataclass(frozen=True, slots=True)
class Rigid:
    """A position in metres and a rotation w + xi + yj + zk of length 1."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0

    def turned(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A vector along this pose's axes, along the axes of the outer frame."""
        a, b, c, w = self.i, self.j, self.k, self.w
        s, t, u = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        return (
            x + w * s + (b * u - c * t),
            y + w * t + (c * s - a * u),
            z + w * u + (a * t - b * s),
        )

    def then(self, inner: Rigid) -> Rigid:
        """The pose in the outer frame of a pose that is relative to this one."""
        x, y, z = self.turned(inner.x, inner.y, inner.z)
        w, i, j, k = product(self, inner)
        return Rigid(self.x + x, self.y + y, self.z + z, *_unit(w, i, j, k))

    def inverse(self) -> Rigid:
        """The pose of the outer frame relative to this one."""
        back = Rigid(0.0, 0.0, 0.0, self.w, -self.i, -self.j, -self.k)
        x, y, z = back.turned(-self.x, -self.y, -self.z)
        return Rigid(x, y, z, back.w, back.i, back.j, back.k)

    def toward(self, end: Rigid, share: float) -> Rigid:
        """The pose a share of the way to another one; `end` itself for 1."""
        if share == 1.0:
            return end
        # A rotation has two quaternions; this is the shorter way.
        near = self.w * end.w + self.i * end.i + self.j * end.j + self.k * end.k >= 0.0
        signs = (1.0, 1.0, 1.0, *[1.0 if near else -1.0] * 4)
        pairs = zip(self.numbers, end.numbers, signs, strict=True)
        return Rigid.quaternion(*[a + share * (sign * b - a) for a, b, sign in pairs])

    @property
    def numbers(self) -> tuple[float, ...]:
        """x, y, z, w, i, j, k."""
        return self.x, self.y, self.z, self.w, self.i, self.j, self.k

    @staticmethod
    def euler(
        x: float, y: float, z: float, turn: float = 0.0, pitch: float = 0.0, roll: float = 0.0
    ) -> Rigid:
        """A translation, a turn about z, a pitch about the new y, a roll about the new x (deg)."""
        made = Rigid(x, y, z)
        for angle, axis in ((turn, 2), (pitch, 1), (roll, 0)):
            if angle:
                cos, sin = portable.cos_sin(math.radians(angle) / 2.0)
                along = [0.0, 0.0, 0.0]
                along[axis] = sin
                made = made.then(Rigid(0.0, 0.0, 0.0, cos, *along))
        return made

    @staticmethod
    def quaternion(x: float, y: float, z: float, w: float, i: float, j: float, k: float) -> Rigid:
        """A translation and a rotation of any length. Raises BodiesError for one of length 0."""
        if not w * w + i * i + j * j + k * k > 0.0:
            raise BodiesError(
                f"the rotation <{w}, {i}, {j}, {k}> has no length; expected a quaternion"
            )
        return Rigid(x, y, z, *_unit(w, i, j, k))


def product(a: Rigid, b: Rigid) -> tuple[float, float, float, float]:
    """The rotation w, i, j, k of b, then of a."""
    return (
        a.w * b.w - a.i * b.i - a.j * b.j - a.k * b.k,
        a.w * b.i + a.i * b.w + a.j * b.k - a.k * b.j,
        a.w * b.j - a.i * b.k + a.j * b.w + a.k * b.i,
        a.w * b.k + a.i * b.j - a.j * b.i + a.k * b.w,
    )


def _unit(w: float, i: float, j: float, k: float) -> tuple[float, float, float, float]:
    # IEEE 754 defines the square root and the quotient to the last bit.
    length = math.sqrt(w * w + i * i + j * j + k * k)
    return w / length, i / length, j / length, k / length
