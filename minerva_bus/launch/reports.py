"""What the coordinator's process tells the launcher, one JSON object a line, and back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, cast


@dataclass(slots=True)
class Lines:
    """Whole lines out of pieces as a pipe gives them; a line of over a megabyte is cut."""

    limit: int = 1_000_000
    _rest: bytes = b""

    def feed(self, data: bytes) -> Iterator[str]:
        """The lines that are whole now."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > self.limit:
            lines.append(self._rest)
            self._rest = b""
        for line in lines:
            yield line.decode("utf-8", "replace")

    def end(self) -> str:
        """What is left when no more comes."""
        rest, self._rest = self._rest, b""
        return rest.decode("utf-8", "replace")


@dataclass(slots=True)
class Reports:
    """Writes reports to a pipe."""

    descriptor: int
    gone: bool = field(default=False)

    def tell(self, kind: str, **what: Any) -> None:
        """Send one report; nothing happens where nobody listens any more."""
        data = json.dumps({"kind": kind, **what}).encode() + b"\n"
        try:
            while data and not self.gone:
                data = data[os.write(self.descriptor, data) :]
        except OSError:
            self.gone = True


def parsed(line: str) -> dict[str, Any] | None:
    """A report, or None for a line that is none."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return cast("dict[str, Any]", found) if isinstance(found, dict) else None
