"""Which agent has which address: ids of the string, and JIDs of XMPP (RFC 7622)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import AGENT_ID

_JID: Final = re.compile(r"[^@/\s\"&'<>:]+@[^@/\s]+")


class Addresses:
    """JIDs by id, and back. Where a pattern gives them, of the ids that it was asked for."""

    def __init__(self, known: Mapping[str, str], pattern: str = "") -> None:
        self._pattern = pattern
        self._jids: dict[str, str] = {}
        self._ids: dict[str, str] = {}
        for id, jid in known.items():
            self._add(id, jid)

    @staticmethod
    def of(option: str, given: Any, domain: str) -> Addresses:
        """Those that an option gives: a table, a list of ids, or a pattern with `{id}` in it.

        A list may be a text with commas; its addresses are `ID@domain`. Raises MisuseError.
        """
        if isinstance(given, str) and "{id}" in given:
            _checked(option, given.replace("{id}", "id"))
            return Addresses({}, given)
        if isinstance(given, Mapping):
            table = cast("Mapping[str, object]", given)
            return Addresses({id: _checked(option, jid) for id, jid in table.items()})
        ids = _listed(option, given)
        if ids and not domain:
            raise MisuseError(f"spade: {option} has no addresses; give the option domain")
        return Addresses({id: _checked(option, f"{id}@{domain}") for id in ids})

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._jids))

    def __len__(self) -> int:
        return len(self._jids)

    def meet(self, ids: Iterable[str]) -> None:
        """Agents of these ids are there: those that have no address get one of the pattern."""
        for id in ids:
            if self._pattern and id not in self._jids:
                self._add(id, self._pattern.replace("{id}", id))

    def jid(self, id: str) -> str:
        """The JID of an agent; the empty text where it has none."""
        return self._jids.get(id, "")

    def id(self, jid: str) -> str:
        """The agent that has a JID, whatever its resource; the empty text where none has."""
        return self._ids.get(jid.partition("/")[0].lower(), "")

    def _add(self, id: str, jid: str) -> None:
        if AGENT_ID.fullmatch(id) is None:
            raise MisuseError(f"spade: {id!r} is no id of an agent: letters, digits and _ : - only")
        other = self._ids.setdefault(jid.lower(), id)
        if other != id:
            raise MisuseError(f"spade: {jid} is the address of both #{other} and #{id}")
        self._jids[id] = jid


def _listed(option: str, given: Any) -> list[str]:
    if isinstance(given, str):
        return [one.strip() for one in given.split(",") if one.strip()]
    ids = list(cast("Iterable[object]", given)) if isinstance(given, list | tuple) else [given]
    if not all(isinstance(one, str) for one in ids):
        raise MisuseError(
            f"spade: {option} must be a list of ids, a table of ids and JIDs, or a pattern"
            ' such as "{id}@example.org"'
        )
    return cast("list[str]", ids)


def _checked(option: str, jid: object) -> str:
    if not isinstance(jid, str) or _JID.fullmatch(jid) is None:
        raise MisuseError(f"spade: {option}: {jid!r} is no address; expected NAME@DOMAIN")
    return jid
