"""How far the regions of a world file run ahead of each other, or what keeps them in step."""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.frame.lag import Lag
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.regions.attached import is_attached
from minerva_bus.regions.schedule import IN_STEP, Schedule
from minerva_bus.wording import counted


def schedule_of(file: WorldFile) -> Schedule:
    """The schedule of the regions of a file whose processes are those inside regions."""
    lag = file.world.lag
    if lag is None:
        return IN_STEP
    return Schedule(lag.every, 0 if _in_step_by(file) else _most_ahead(lag))


def notes_on(file: WorldFile) -> Sequence[str]:
    """What a person has to know of it before the run."""
    lag = file.world.lag
    if lag is None or lag.every == 1:
        return []
    reason = _in_step_by(file)
    if reason:
        return [f"regions wait for each other in each frame, because of {reason}"]
    return [f"regions run up to {counted(_most_ahead(lag), 'frame')} ahead of each other"]


def _most_ahead(lag: Lag) -> int:
    return min(lag.frames, lag.every - 1)


def _in_step_by(file: WorldFile) -> str:
    """What has to know or change the whole world in each frame; empty: nothing."""
    if file.world.norms:
        return "norms"
    attached = [each.name for each in file.processes if is_attached(each.participant().service)]
    return f"views and sensor topics ({', '.join(attached)})" if attached else ""
