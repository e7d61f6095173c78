"""How far the regions of a world run ahead of each other, or what keeps them in step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from minerva_bus.frame.description import World
from minerva_bus.regions.attached import is_attached
from minerva_bus.wording import counted
from minerva_bus.world.services import Service


def frames_ahead(world: World, services: Mapping[str, Service | None]) -> tuple[int, Sequence[str]]:
    """The frames by which regions with these services run ahead, and what a person has to know."""
    most = 0 if world.lag is None else min(world.lag.frames, world.lag.every - 1)
    if not most:
        return 0, []
    if reason := _in_step_by(world, services):
        return 0, [f"regions wait for each other in each frame, because of {reason}"]
    return most, [f"regions run up to {counted(most, 'frame')} ahead of each other"]


def _in_step_by(world: World, services: Mapping[str, Service | None]) -> str:
    """What has to know or change the whole world in each frame; empty: nothing."""
    naming = [norm.name for norm in world.norms if norm.named]
    if naming:
        return f"norms that name other agents ({', '.join(naming)})"
    attached = [name for name, service in services.items() if is_attached(service)]
    return f"views and sensor topics ({', '.join(attached)})" if attached else ""
