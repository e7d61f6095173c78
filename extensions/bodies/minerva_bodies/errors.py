"""Errors of worlds in space."""

from __future__ import annotations

from minerva_bus.errors import MinervaError


class BodiesError(MinervaError, ValueError):
    """A solid, joint, command, mesh or saved state that the world in space cannot use."""
