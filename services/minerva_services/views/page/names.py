"""The names of pages and their people, each held by one page at a time."""

from __future__ import annotations

import re
from collections.abc import Collection, Generator
from contextlib import contextmanager

from minerva_bus.errors import MisuseError
from minerva_bus.wire.keys import checked_name, is_name

_OF_EACH = "-*"


def read_joins(text: str) -> tuple[str, ...]:
    """Names from the option `joins`, such as `snails tilt-*`. Raises MisuseError for others."""
    names = tuple(dict.fromkeys(text.replace(",", " ").split()))
    for name in names:
        if not is_name(name.removesuffix("*")) or ("*" in name and not name.endswith(_OF_EACH)):
            raise MisuseError(
                f"page: joins has {name!r}; expected NAME, or NAME-* for a member of each page"
            )
    return names


class PageNames:
    """Numbers of pages, and names of members that pages hold.

    Page n takes part as `page-n`, and in place of a name `NAME-*` as `NAME-n`.
    """

    def __init__(self, prefix: str, joins: Collection[str]) -> None:
        self._prefix = prefix
        self._joins = joins
        self._pages: set[int] = set()
        self._people: dict[int, str] = {}
        self._taken: set[str] = set()
        names = (f"{prefix}{_OF_EACH}", *joins)
        numbered = "[1-9][0-9]{0,5}"
        self._allowed = re.compile(
            "|".join(re.escape(name).replace(re.escape("*"), numbered) for name in names)
        )

    @property
    def count(self) -> int:
        """The number of pages."""
        return len(self._pages)

    @property
    def taken(self) -> list[str]:
        """The names that are held, sorted."""
        return sorted(self._taken)

    def of_page(self, number: int) -> str:
        """The name of a page."""
        return f"{self._prefix}-{number}"

    def joins_of(self, number: int) -> dict[str, str]:
        """The names under which a page may take part besides, by their names in `joins`."""
        return {name: name.replace("*", str(number)) for name in self._joins}

    @contextmanager
    def page(self) -> Generator[int]:
        """The lowest free number of a page."""
        number = next(
            number for number in range(1, len(self._pages) + 2) if number not in self._pages
        )
        self._pages.add(number)
        try:
            yield number
        finally:
            self._pages.discard(number)
            self._people.pop(number, None)

    def person(self, number: int) -> str:
        """The name of the person at a page: the chosen one, or that of the page."""
        return self._people.get(number, self.of_page(number))

    @property
    def people(self) -> list[str]:
        """The names of the people at all pages, sorted."""
        return sorted(map(self.person, self._pages))

    def choose(self, number: int, name: str) -> None:
        """Give the person at a page a name; "" is that of the page.

        Raises MisuseError for a text that is not a name, and for that of another page or person.
        """
        if name in ("", self.of_page(number)):
            self._people.pop(number, None)
            return
        checked_name(name, "a person")
        others = {self.person(page) for page in self._pages if page != number}
        if self._allowed.fullmatch(name) or name in others:
            raise MisuseError(f"{name} is the name of another page or person; choose another one")
        self._people[number] = name

    def objection(self, name: str) -> str:
        """Why no page may take a name; empty if one may."""
        if not self._allowed.fullmatch(name):
            return f"pages may not take part as {name[:64]!r}"
        return f"{name} takes part in another page" if name in self._taken else ""

    @contextmanager
    def held(self, name: str) -> Generator[None]:
        """Hold a name, to which there was no objection."""
        self._taken.add(name)
        try:
            yield
        finally:
            self._taken.discard(name)
