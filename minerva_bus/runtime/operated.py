"""What operators' questions act on: the parts of a running world, and who asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.event_log import EventLog
from minerva_bus.frame.orders import OrderFates
from minerva_bus.frame.pace import Pace
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.runtime.runner import Runner
from minerva_bus.runtime.schedule import FrameSchedule
from minerva_bus.runtime.status import StatusMeter
from minerva_bus.wire.keys import is_name
from minerva_bus.wire.plain import as_text
from minerva_bus.world.operator import FileStatus, PersonOperation

if TYPE_CHECKING:
    from minerva_bus.collect.history import SeriesHistory


ASKER: Final = "asker"
"""Name of the certificate of a question, which the coordinator adds; empty without certificates."""


@dataclass(frozen=True, slots=True)
class Operated:
    """The parts of a running world that operators' commands use.

    `rejected` gives the number of rejections by sender, `outlook` what the world does with an
    awaited member, and `files` what it writes. `restart` requests a restart of a member, `stack`
    that its stacks are written to its log; both return the reason if that is impossible, otherwise
    an empty string. `orders` has the fates of people's orders, `collected` the collected series, if
    any. `noted` receives each operation of a person.
    """

    runner: Runner
    schedule: FrameSchedule
    event_log: EventLog
    orders: OrderFates
    metrics: Metrics
    status: StatusMeter
    rejected: Callable[[], Mapping[str, int]]
    restart: Callable[[str], str]
    stack: Callable[[str], str]
    collected: SeriesHistory | None = None
    outlook: Callable[[str], str] = field(default=lambda _: "")
    files: Callable[[], tuple[FileStatus, ...]] = field(default=lambda: ())
    noted: Callable[[PersonOperation], None] = field(default=lambda _: None)

    @property
    def algorithm(self) -> FrameAlgorithm:
        """The frame algorithm."""
        return self.runner.algorithm

    @property
    def pace(self) -> Pace:
        """The frame rate and the number of frames that may begin."""
        return self.schedule.pace


Command: TypeAlias = Callable[[Operated, dict[str, Any]], dict[str, Any]]


def person_of(asked: Mapping[str, Any]) -> str:
    """The name of the person who asks.

    With certificates it begins with the name of the certificate, which a question cannot change.
    """
    by, asker = as_text(asked.get("by", ""), "by"), as_text(asked.get(ASKER, ""), "the asker")
    if by and not is_name(by):
        raise ProtocolError(f"by: {by[:64]!r} is not a name: use letters, digits, _, - and .")
    return "/".join(dict.fromkeys(name for name in (asker, by) if name))
