"""What members have said of their failures, how it is shown, and whether it would happen again."""

from __future__ import annotations

import re
from typing import Final

from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.member import RAISED

REPORT_BEGINS: Final = re.compile(r"failed(?: in frame \d+)?: ")


class Failures:
    """The failures of user code in one run."""

    def __init__(self) -> None:
        self._shown: set[str] = set()
        self._before: set[tuple[str, str]] = set()

    def shown(self, text: str) -> str:
        """A report as people see it: of lines that they have seen already, the first only.

        Nothing where they have seen all of it.
        """
        first, _, rest = text.partition("\n")
        seen, self._shown = self._shown, self._shown | {first, rest}
        if first in seen and rest in seen:
            return ""
        return f"{first} (as above)" if rest and rest in seen else text

    def lasting(self, process: Process, code: int, cause: str) -> bool:
        """Whether a process has failed as it, or another host, did before: by the same cause.

        The cause names the frame and what was called for; the same input gives the same again.
        """
        if code != RAISED or not cause:
            return False
        key = ("" if process.agents else process.name, cause)
        lasting = key in self._before
        self._before.add(key)
        return lasting
