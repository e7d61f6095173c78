"""Mapping between agent ids and XMPP addresses (JIDs, RFC 7622)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import AGENT_ID

_JID: Final = re.compile(r"[^@/\s\"&'<>:]+@[^@/\s]+")


class Addresses:
    """JIDs by id and vice versa; a pattern creates JIDs for ids on demand."""

    def __init__(self, known: Mapping[str, str], pattern: str = "") -> None:
        self._pattern = pattern
        self._jids: dict[str, str] = {}
        self._ids: dict[str, str] = {}
        for id, jid in known.items():
            self._add(id, jid)

    @staticmethod
    def of(option: str, value: Any, domain: str) -> Addresses:
        """Parse an option: a table, a list of ids, or a pattern that contains `{id}`.

        A list may be a comma-separated string; its addresses are `ID@domain`. Raises MisuseError.
        """
        if isinstance(value, str) and "{id}" in value:
            _checked(option, value.replace("{id}", "id"))
            return Addresses({}, value)
        if isinstance(value, Mapping):
            table = cast("Mapping[str, object]", value)
            return Addresses({id: _checked(option, jid) for id, jid in table.items()})
        ids = _listed(option, value)
        if ids and not domain:
            raise MisuseError(f"spade: {option} has ids without addresses; set the option domain")
        return Addresses({id: _checked(option, f"{id}@{domain}") for id in ids})

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._jids))

    def __len__(self) -> int:
        return len(self._jids)

    def add_ids(self, ids: Iterable[str]) -> None:
        """Create addresses for new ids by the pattern."""
        for id in ids:
            if self._pattern and id not in self._jids:
                self._add(id, self._pattern.replace("{id}", id))

    def jid(self, id: str) -> str:
        """The JID of an agent; "" if it has none."""
        return self._jids.get(id, "")

    def id(self, jid: str) -> str:
        """The agent with this JID, ignoring its resource; "" if there is none."""
        # Local and domain part of a JID are case-insensitive (RFC 7622, 3.2 and 3.3).
        return self._ids.get(jid.partition("/")[0].lower(), "")

    def _add(self, id: str, jid: str) -> None:
        if AGENT_ID.fullmatch(id) is None:
            raise MisuseError(
                f"spade: {id!r} is not an agent id; expected letters, digits and _ : -"
            )
        other = self._ids.setdefault(jid.lower(), id)
        if other != id:
            raise MisuseError(f"spade: {jid} is the address of both #{other} and #{id}")
        self._jids[id] = jid


def _listed(option: str, value: Any) -> list[str]:
    if isinstance(value, str):
        return [id.strip() for id in value.split(",") if id.strip()]
    ids = list(cast("Iterable[object]", value)) if isinstance(value, list | tuple) else [value]
    if not all(isinstance(id, str) for id in ids):
        raise MisuseError(
            f"spade: {option} must be a list of ids, a table of ids and JIDs, or a pattern"
            ' such as "{id}@example.org"'
        )
    return cast("list[str]", ids)


def _checked(option: str, jid: object) -> str:
    if not isinstance(jid, str) or _JID.fullmatch(jid) is None:
        raise MisuseError(f"spade: {option}: {jid!r} is not an address; expected NAME@DOMAIN")
    return jid
