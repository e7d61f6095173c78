"""Pose graph optimisation: poses from relative measurements between them.

After Grisetti, Kümmerle, Stachniss and Burgard, "A Tutorial on Graph-Based SLAM" (2010).
Contradictory loop closures are switched off by dynamic covariance scaling (Agarwal et al., "Robust
Map Optimization using Dynamic Covariance Scaling", ICRA 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from minerva_agents.robot.motion import Reals

_linalg: Any = linalg

_SWITCH: Final = 10.0
"""Squared standard deviations beyond which dynamic covariance scaling weakens a closure."""


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Pose of keyframe `to` relative to `begin` (m, m, rad), and its certainty.

    `information` is the inverse covariance, (3, 3).
    """

    begin: int
    to: int
    step: Reals
    information: Reals
    closes: bool = False


# Some hundred poses do not justify GTSAM or g2o: each is a C++ framework, this is a page.
def optimised(poses: Reals, edges: Sequence[Edge], rounds: int = 15) -> tuple[Reals, Reals]:
    """The poses that minimise the error of all edges, and each edge's weight, 0 to 1.

    Gauss-Newton; the first pose is fixed.
    """
    poses, counts = poses.copy(), np.ones(len(edges))
    begin = np.array([edge.begin for edge in edges])
    to = np.array([edge.to for edge in edges])
    steps = np.array([edge.step for edge in edges])
    information = np.array([edge.information for edge in edges])
    closes = np.array([edge.closes for edge in edges])
    columns = np.concatenate([3 * begin[:, None] + [0, 1, 2], 3 * to[:, None] + [0, 1, 2]], axis=1)
    for _ in range(rounds):
        errors, slopes = _errors(poses[begin], poses[to], steps)
        chi = np.einsum("ei,eij,ej->e", errors, information, errors)
        # Dynamic covariance scaling: wrong closures lose weight instead of bending the map.
        counts = np.where(closes, np.minimum(1.0, 2 * _SWITCH / (_SWITCH + chi)) ** 2, 1.0)
        weights = information * counts[:, None, None]
        squares = np.einsum("eki,ekl,elj->eij", slopes, weights, slopes)
        sides = np.einsum("eki,ekl,el->ei", slopes, weights, errors)
        rows = np.repeat(columns[:, :, None], 6, axis=2)
        matrix = sparse.coo_matrix(
            (squares.ravel(), (rows.ravel(), rows.transpose(0, 2, 1).ravel())),
            shape=(poses.size, poses.size),
        ).tocsc()
        right = np.bincount(columns.ravel(), sides.ravel(), poses.size)
        change = np.zeros(poses.size)
        # With the first pose free the system would be singular: edges are relative.
        change[3:] = _linalg.spsolve(matrix[3:, 3:], -right[3:])
        poses += change.reshape(-1, 3)
        # No pose has moved by more than a tenth of a millimetre, or 1e-4 rad.
        if np.abs(change).max() < 1e-4:
            break
    return poses, counts


def _errors(first: Reals, second: Reals, steps: Reals) -> tuple[Reals, Reals]:
    """Residuals of the edges, (e, 3), and their Jacobians, (e, 3, 6)."""
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    x, y = (second[:, :2] - first[:, :2]).T
    ahead, left = cos * x + sin * y, cos * y - sin * x
    turn = second[:, 2] - first[:, 2] - steps[:, 2]
    # A full turn is not an error.
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    errors = np.stack([ahead - steps[:, 0], left - steps[:, 1], turn], axis=1)
    slopes = np.zeros((len(first), 3, 6))
    slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 0, 2] = -cos, -sin, left
    slopes[:, 1, 0], slopes[:, 1, 1], slopes[:, 1, 2] = sin, -cos, -ahead
    slopes[:, 0, 3], slopes[:, 0, 4] = cos, sin
    slopes[:, 1, 3], slopes[:, 1, 4] = -sin, cos
    slopes[:, 2, 2], slopes[:, 2, 5] = -1.0, 1.0
    return errors, slopes
