"""Log lines as data: one JSON object a line, the same from the launcher and from `minerva logs`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

LEVELS: Final = ("info", "warning", "error")


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a log.

    `time` is in seconds since 1970; `frame` the one under way, -1 where none is known yet; `member`
    who it is from or about, empty for the world itself; `level` one of LEVELS.
    """

    time: float
    level: str
    world: str
    frame: int
    member: str
    message: str

    def json(self) -> str:
        """The entry as one line of JSON; its time as RFC 3339 has it, in UTC."""
        at = datetime.fromtimestamp(self.time, UTC).isoformat(timespec="milliseconds")
        return json.dumps(
            {
                "time": at.replace("+00:00", "Z"),
                "level": self.level,
                "world": self.world,
                "frame": self.frame,
                "member": self.member,
                "message": self.message,
            },
            ensure_ascii=False,
        )
