"""Topic patterns: MQTT topic filters whose levels have names."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from minerva_bus.errors import MisuseError

_NAMED = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}")


@dataclass(frozen=True, slots=True)
class Pattern:
    """A pattern such as `home/{room}/temperature`, `home/+/#`.

    `{room}` matches one level like `+` and names it; each `+` is named by its position, from 1.
    `filter` is the subscription sent to the broker (MQTT 3.1.1, 4.7).
    """

    text: str
    filter: str
    names: tuple[str, ...]
    _matches: re.Pattern[str]

    @staticmethod
    def of(text: str) -> Pattern:
        """Parse a pattern. Raises MisuseError."""
        names: list[str] = []
        levels: list[str] = []
        parts: list[str] = []
        unnamed = 0
        for level in _levels(text):
            named = _NAMED.fullmatch(level)
            if named or level == "+":
                unnamed += named is None
                names.append(named[1] if named else str(unnamed))
                levels.append("+")
                parts.append("([^/]*)")
            else:
                levels.append(level)
                parts.append(re.escape(level) if level != "#" else ".*")
        if len(set(names)) != len(names):
            raise _wrong(text, "a name for one level only")
        expression = "/".join(parts)
        if levels[-1] == "#":
            # `a/#` also matches `a` itself (MQTT 3.1.1, 4.7.1.2).
            expression = expression.removesuffix("/.*") + "(?:/.*)?" if len(levels) > 1 else ".*"
        # DOTALL, because topics may contain line breaks.
        return Pattern(text, "/".join(levels), tuple(names), re.compile(expression, re.DOTALL))

    def levels(self, topic: str) -> Mapping[str, str] | None:
        """The named levels of a topic; None if it does not match."""
        match = self._matches.fullmatch(topic)
        if match is None:
            return None
        return dict(zip(self.names, match.groups(), strict=True))


def _levels(text: str) -> list[str]:
    if not text or "\0" in text or len(text.encode()) > 65535:
        raise _wrong(text, "up to 65535 bytes of text")
    levels = text.split("/")
    if "#" in levels[:-1]:
        raise _wrong(text, "# as the last level only")
    for level in levels:
        if level not in ("+", "#") and not _NAMED.fullmatch(level) and set(level) & set("+#{}"):
            raise _wrong(text, "+, # and {name} as whole levels")
    return levels


def _wrong(text: str, expected: str) -> MisuseError:
    return MisuseError(f"mqtt: topic {text[:80]!r}; expected {expected}")
