"""What a world file says of norms: a table [norm.NAME] for each.

    [norm.speed_limit]
    applies = "ACar"
    when = "speed > 14"
    then = "sanction"
    event = "eFine"
    data = { amount = 30.0 }

docs/norms.md has every key.
"""

from __future__ import annotations

import sys
from collections.abc import Collection
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, VocabularyError, WorldFileError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.table import Table
from minerva_bus.world.norms import REFUSED, Norm, Then, check_condition, sanction_of

PEOPLE: Final = "people"
"""How a norm names those who send events from a terminal or a window."""

_THEN = tuple(one.value for one in Then)
_MOST = sys.float_info.max
_SOURCES = {PEOPLE: "~order"}


def read_norms(
    table: Table, vocabulary: Vocabulary, scene: Scene, members: Collection[str]
) -> tuple[Norm, ...]:
    """The norms of a world file that are in force, in the order of the file.

    `members` are the names of its processes. Raises WorldFileError.
    """
    found: list[Norm] = []
    for name in list(table.data):
        inner = table.table(name)
        norm, in_force = _norm(name, inner, vocabulary, members), inner.truth("in_force", True)
        inner.done()
        _check(norm, inner, vocabulary, scene)
        found += [norm] if in_force else []
    return tuple(found)


def _norm(name: str, table: Table, vocabulary: Vocabulary, members: Collection[str]) -> Norm:
    kinds, events = list(vocabulary.kinds), list(vocabulary.events)
    on = _known(table, "on", events, "event type")
    for one in on:
        if vocabulary.events[one].visual:
            table.wrong("on", f"names {one}, which is visual: no norm is about views")
    applies = _known(table, "applies", [*kinds, *members, PEOPLE], "agent kind or process")
    for one in applies:
        if not on and one not in kinds:
            table.wrong("applies", f"names {one}, which is no agent: only norms `on` events can")
    when, where = table.text("when"), _where(table)
    most, per = table.whole("most", 0), table.whole("per", 1, least=1)
    then = Then(table.choice("then", _THEN))
    return Norm(
        name,
        tuple([_SOURCES.get(one, one) for one in applies]),
        on,
        when,
        where,
        most,
        per,
        then,
        _sanction(name, table, vocabulary, then),
    )


def _known(table: Table, key: str, known: list[str], what: str) -> tuple[str, ...]:
    names = table.texts(key)
    for one in names:
        if one not in known:
            table.wrong(key, f"has the unknown {what} {one}{nearest(one, known)}")
    return names


def _where(table: Table) -> str:
    """A condition, or the corners x0, y0, x1, y1 of a part of the plane: of attributes x and y."""
    given = table.data.get("where", "")
    if not isinstance(given, list):
        return table.text("where")
    table.asked("where")
    corners = cast("list[Any]", given)
    numbers = [one for one in corners if isinstance(one, int | float) and not isinstance(one, bool)]
    if len(numbers) != 4 or len(corners) != 4 or any(not abs(one) <= _MOST for one in numbers):
        table.wrong("where", "must be a condition, or the corners [x0, y0, x1, y1]")
    (x0, x1), (y0, y1) = sorted(map(float, numbers[::2])), sorted(map(float, numbers[1::2]))
    return f"x >= {x0} and x <= {x1} and y >= {y0} and y <= {y1}"


def _sanction(name: str, table: Table, vocabulary: Vocabulary, then: Then) -> Event | None:
    event, data = table.text("event"), table.table("data").rest()
    if not event:
        if then is Then.SANCTION:
            table.wrong("then", "is a sanction: event says which one")
        if data:
            table.wrong("data", "belongs to an event")
        return None
    if then is Then.COUNT:
        table.wrong("event", "follows where then is refuse or sanction")
    if event not in vocabulary.events:
        table.wrong("event", f"is unknown: {event}{nearest(event, list(vocabulary.events))}")
    try:
        return sanction_of(name, vocabulary.events[event], data)
    except (MisuseError, VocabularyError) as error:
        table.wrong("data" if data else "event", f"is wrong: {error}")


def _check(norm: Norm, table: Table, vocabulary: Vocabulary, scene: Scene) -> None:
    """Look whether conditions can be fulfilled; a norm without any is about all."""
    if not (norm.on or norm.when.strip() or norm.where.strip()):
        table.wrong("when", "is missing, and where: what would be forbidden?")
    if REFUSED in vocabulary.events and norm.refuses and not norm.on:
        try:
            sanction_of(norm.name, vocabulary.events[REFUSED], {})
        except (MisuseError, VocabularyError) as error:
            table.wrong(
                "then", f"tells who is refused by {REFUSED}, of which only norm is known: {error}"
            )
    for key in ("when", "where"):
        try:
            check_condition(norm, getattr(norm, key), vocabulary, scene, table.place(key))
        except VocabularyError as error:
            raise WorldFileError(str(error)) from None
