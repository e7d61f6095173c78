"""TOML tables read strictly: every key known, every value of its type, errors with their line."""

from __future__ import annotations

import re
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any, Final, NoReturn, cast

from minerva_bus.errors import MisuseError, SceneError, WorldFileError, nearest
from minerva_bus.wire.keys import checked_name

MOST: Final = (1 << 63) - 1
"""The greatest whole number that messages carry."""


class Table:
    """One table of a world file; `done` complains of keys that nobody asked for."""

    def __init__(self, data: Mapping[str, Any], name: str, text: str, source: str) -> None:
        self.data = dict(data)
        self.name = name
        self._text = text
        self._source = source
        self._asked: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def text(self, key: str, default: str = "") -> str:
        """A text."""
        return self._get(key, str, default, "a text")

    def whole(self, key: str, default: int, least: int = 0, most: int = MOST) -> int:
        """A whole number, not under `least` nor over `most`."""
        value = self._get(key, int, default, "a whole number")
        if value < least:
            self.wrong(key, f"must be at least {least}")
        if value > most:
            self.wrong(key, f"must be at most {most}")
        return value

    def number(self, key: str, default: float, least: float = 0.0) -> float:
        """A number, not under `least`."""
        value = self._get(key, (int, float), default, "a number")
        if not least <= value < float("inf"):
            self.wrong(key, f"must be a number from {least:g}")
        return float(value)

    def truth(self, key: str, default: bool) -> bool:
        """True or false."""
        return self._get(key, bool, default, "true or false")

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of texts, or one text alone."""
        value = self._get(key, (list, str), [], "a list of texts")
        items = [value] if isinstance(value, str) else cast("list[Any]", value)
        if not all(isinstance(item, str) for item in items):
            self.wrong(key, "must be a list of texts")
        return tuple(items)

    def choice(self, key: str, choices: tuple[str, ...]) -> str:
        """One of some texts; the first where it is not given."""
        value = self.text(key, choices[0])
        if value not in choices:
            self.wrong(key, f"must be one of {', '.join(choices)}{nearest(value, list(choices))}")
        return value

    def named(self, name: str, what: str) -> str:
        """A name that something of this table has, where it is one that the bus can carry."""
        try:
            return checked_name(name, what)
        except MisuseError as error:
            raise WorldFileError(f"{self._source}: {error}") from None

    def table(self, key: str) -> Table:
        """A table within this one; empty where it is not given."""
        data = self._get(key, dict, {}, "a table")
        name = f"{self.name}.{key}" if self.name else key
        return Table(cast("dict[str, Any]", data), name, self._text, self._source)

    def rest(self) -> dict[str, Any]:
        """All that has not been asked for yet."""
        left = {key: value for key, value in self.data.items() if key not in self._asked}
        self._asked += left
        return left

    def asked(self, key: str) -> None:
        """A key that is read elsewhere."""
        self._asked.append(key)

    def place(self, key: str) -> str:
        """Where a key stands, for messages: file, line and name."""
        at = self._place(key)
        line = f":{self._text.count(chr(10), 0, at) + 1}" if at >= 0 else ""
        return f"{self._source}{line}: {self.name}.{key}"

    def done(self) -> None:
        """Complain of unknown keys."""
        for key in self.data:
            if key not in self._asked:
                known = ", ".join(self._asked)
                where = f"[{self.name}]" if self.name else "a world file"
                self.wrong(key, f"is unknown{nearest(key, self._asked)}; {where} has {known}")

    @contextmanager
    def loading(self, key: str) -> Generator[None]:
        """What a key names is looked for: who misses it is told where the name stands."""
        try:
            yield
        except WorldFileError as error:
            text, _, place = str(error).partition("\n")
            if place:  # In a module: the line there says more than the one here.
                full = f"{self.name}.{key}" if self.name else key
                raise WorldFileError(f"{self._source}: {full}: {text}\n{place}") from error
            self._raise(key, f": {text}")

    def wrong(self, key: str, problem: str) -> NoReturn:
        """Raise WorldFileError about a key, with its line and a caret."""
        self._raise(key, f" {problem}")

    def _raise(self, key: str, problem: str) -> NoReturn:
        full = f"{self.name}.{key}" if self.name else key
        raise WorldFileError(
            str(
                SceneError(
                    f"{full}{problem}",
                    text=self._text,
                    offset=self._place(key),
                    source=self._source,
                )
            )
        )

    def _place(self, key: str) -> int:
        start = 0
        if self.name:
            header = re.search(rf"^[ \t]*\[[ \t]*{re.escape(self.name)}[ \t]*\]", self._text, re.M)
            start = header.end() if header else 0
        pattern = rf"^[ \t]*(\[([\w.]*\.)?)?(?P<key>\"?{re.escape(key)}\"?)\s*[=\].]"
        match = re.compile(pattern, re.M).search(self._text, start)
        return match.start("key") if match else -1

    def _get(self, key: str, wanted: Any, default: Any, name: str) -> Any:
        self._asked.append(key)
        value = self.data.get(key, default)
        if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
            self.wrong(key, f"must be {name}")
        return value
