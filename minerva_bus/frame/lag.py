"""Lag: events across borders between parts of the string count some frames later.

The parts are a property of the world, as are the frames, so a world has the same string however
many coordinators run it. Agents move to other parts in some frames only, and between them each is
*at home* in the part where it was in the last of these.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.scene import Scene

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm
    from minerva_bus.frame.composition import Composition

HOMES: Final = "~homes"
"""Key in `Checkpoint.saved` for the agents that are not at home where they are."""

Divided: TypeAlias = tuple[Sequence[AnyEvent], Sequence[AnyEvent]]
"""What agents have sent in a frame: events for the next one, and those for a later one."""

NOWHERE: Final = -1
"""Home of an agent that has been born since agents could last move."""


@dataclass(frozen=True, slots=True)
class Homes:
    """The homes of agents: the parts where they are in a string, except for `strays`."""

    scene: Scene
    strays: Mapping[str, int] = field(default_factory=dict[str, int])


class Lag(Protocol):
    """Which events count later, and by how much."""

    @property
    def frames(self) -> int:
        """The additional frames, at least 1."""
        ...

    @property
    def every(self) -> int:
        """Agents move to other parts before the frames that are multiples of this."""
        ...

    def crossing(self, sent: Sequence[AnyEvent], homes: Homes) -> list[NDArray[np.bool_]]:
        """For each event, or batch, of a frame, which of its rows cross a border."""
        ...

    def strays(self, homes: Homes, scene: Scene) -> dict[str, int]:
        """The agents of homes and a later string whose home is not where they are, with it."""
        ...


def homes_at(lag: Lag | None, frame: int, homes: Homes, string: Composition) -> Homes:
    """The homes in a frame that begins with this string, after those of the frame before."""
    return homes if lag is None or frame % lag.every else Homes(string.scene)


def saved_homes(
    lag: Lag | None, frame: int, homes: Homes, string: Composition
) -> dict[str, dict[str, int]]:
    """The entry for `Checkpoint.saved` before a frame that begins with this string."""
    if lag is None or lag.every == 1:
        return {}
    return {HOMES: lag.strays(homes, string.scene) if frame % lag.every else {}}


def saved_strays(saved: Mapping[str, Any]) -> Mapping[str, int]:
    """The strays in `Checkpoint.saved`."""
    return saved.get(HOMES, {})


def note_homes(algorithm: FrameAlgorithm) -> None:
    """Note where agents are at home in the frame that has not replaced its string yet."""
    lag, inbox = algorithm.world.lag, algorithm.inbox
    inbox.homes = homes_at(lag, algorithm.frame, inbox.homes, algorithm.composition)


def note_sent(algorithm: FrameAlgorithm, sent: Sequence[AnyEvent]) -> Divided:
    """Queue what agents have sent in the frame that is complete now; returns it as `divided`."""
    inbox, lag = algorithm.inbox, algorithm.world.lag
    inbox.emitted, late = divided(algorithm, sent)
    if lag is not None:
        inbox.postpone(algorithm.frame + lag.frames, late)
    return inbox.emitted, late


def divided(
    algorithm: FrameAlgorithm, sent: Sequence[AnyEvent]
) -> tuple[list[AnyEvent], list[AnyEvent]]:
    """What agents have sent in a frame: events for the next one, and those for a later one."""
    lag, near, late = algorithm.world.lag, list[AnyEvent](), list[AnyEvent]()
    if lag is None or not sent:
        return [*sent], late
    crossing = lag.crossing(sent, algorithm.inbox.homes)
    for event, crosses in zip(sent, crossing, strict=True):
        near += _rows(event, ~crosses)
        late += _rows(event, crosses)
    return near, late


def _rows(event: AnyEvent, rows: NDArray[np.bool_]) -> list[AnyEvent]:
    if rows.all():
        return [event]
    return [event.take(np.flatnonzero(rows))] if isinstance(event, Events) and rows.any() else []
