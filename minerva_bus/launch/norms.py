"""The norms of a world file, one table [norm.NAME] each.

    [norm.speed_limit]
    applies = "ACar"
    when = "speed > 14"
    then = "sanction"
    event = "eFine"
    data = { amount = 30.0 }

docs/norms.md explains every key.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, VocabularyError, WorldFileError, nearest
from minerva_bus.frame.event_sources import source_of
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.table import Table
from minerva_bus.settings.tables import NormSettings
from minerva_bus.wire.keys import is_name
from minerva_bus.world.norms import REFUSED, Norm, Then, check_conditions, sanction_of

PEOPLE: Final = "people"
"""In `applies`: the people who send events from a terminal or a window; `people:NAME` is one."""

_MAX_FLOAT = sys.float_info.max


def read_norms(
    table: Table, vocabulary: Vocabulary, scene: Scene, members: Collection[str]
) -> tuple[Norm, ...]:
    """The active norms of a world file, in the order of the file.

    `members` are the names of its processes. Raises WorldFileError.
    """
    norms: list[Norm] = []
    for name in list(table.data):
        table.named(name, "a norm")
        inner = table.table(name)
        settings = inner.read(NormSettings)
        norm = _norm(name, inner, settings, vocabulary, members)
        inner.done()
        _check(norm, inner, vocabulary, scene)
        norms += [norm] if settings.in_force else []
    return tuple(norms)


def _norm(
    name: str,
    table: Table,
    settings: NormSettings,
    vocabulary: Vocabulary,
    members: Collection[str],
) -> Norm:
    kinds, events = list(vocabulary.kinds), list(vocabulary.events)
    _check_known(table, "on", settings.on, events, "event type")
    for event in settings.on:
        if vocabulary.events[event].visual:
            table.wrong("on", f"names {event}, which is visual: norms are not about views")
    who = "agent kind or process"
    persons = [subject for subject in settings.applies if subject.startswith(f"{PEOPLE}:")]
    for person in persons:
        # With certificates a person is that of a member, `people:web/page-1`.
        if not all(map(is_name, person.partition(":")[2].split("/"))):
            expected = "people:NAME, with up to 64 letters, digits and _ . ~ -"
            table.wrong("applies", f"names no person by {person[:80]!r}; expected {expected}")
    known = [*kinds, *members, PEOPLE, *persons]
    _check_known(table, "applies", settings.applies, known, who)
    for subject in settings.applies:
        if not settings.on and subject not in kinds:
            table.wrong(
                "applies", f"names {subject}, which is not an agent: only norms `on` events can"
            )
    return Norm(
        name,
        tuple([_source(subject) for subject in settings.applies]),
        settings.on,
        settings.when,
        _where(table, settings),
        settings.most,
        settings.per,
        Then(settings.then),
        _sanction(name, table, settings, vocabulary),
    )


def _source(subject: str) -> str:
    """A subject of `applies` as the frame algorithm names it."""
    who, _, name = subject.partition(":")
    return source_of(name) if who == PEOPLE else subject


def _check_known(table: Table, key: str, names: Iterable[str], known: list[str], what: str) -> None:
    for name in names:
        if name not in known:
            table.wrong(key, f"has the unknown {what} {name}{nearest(name, known)}")


def _where(table: Table, settings: NormSettings) -> str:
    """The condition; the corners of a rectangle are a short form for the attributes x and y."""
    where: Any = settings.where
    if isinstance(where, str):
        return where
    if not isinstance(where, list):
        table.wrong("where", "must be a text")
    corners = cast("list[Any]", where)
    numbers = [
        corner
        for corner in corners
        if isinstance(corner, int | float) and not isinstance(corner, bool)
    ]
    # The limit excludes NaN and infinity, which a condition would read as names, and whole numbers
    # that are too long for a float.
    if len(numbers) != 4 or len(corners) != 4 or any(not abs(x) <= _MAX_FLOAT for x in numbers):
        table.wrong("where", "must be a condition, or the corners [x0, y0, x1, y1]")
    (x0, x1), (y0, y1) = sorted(map(float, numbers[::2])), sorted(map(float, numbers[1::2]))
    return f"x >= {x0} and x <= {x1} and y >= {y0} and y <= {y1}"


def _sanction(
    name: str, table: Table, settings: NormSettings, vocabulary: Vocabulary
) -> Event | None:
    event, then = settings.event, Then(settings.then)
    data = cast("dict[str, Any]", settings.data or {})
    if not event:
        if then is Then.SANCTION:
            table.wrong("then", "is a sanction: `event` must name its event")
        if data:
            table.wrong("data", "is for an event, which is not given")
        return None
    if then is Then.COUNT:
        table.wrong("event", "is sent only if `then` is refuse or sanction")
    if event not in vocabulary.events:
        table.wrong("event", f"is unknown: {event}{nearest(event, list(vocabulary.events))}")
    try:
        return sanction_of(name, vocabulary.events[event], data)
    except (MisuseError, VocabularyError) as error:
        table.wrong("data" if data else "event", f"is wrong: {error}")


def _check(norm: Norm, table: Table, vocabulary: Vocabulary, scene: Scene) -> None:
    """Check that the conditions can hold; a norm about states needs one."""
    if not (norm.on or norm.when.strip() or norm.where.strip()):
        table.wrong("when", "is missing, and so is where: what is forbidden?")
    if REFUSED in vocabulary.events and norm.refuses and not norm.on:
        try:
            sanction_of(norm.name, vocabulary.events[REFUSED], {})
        except (MisuseError, VocabularyError) as error:
            table.wrong("then", f"sends {REFUSED}, which may have no data but norm: {error}")
    try:
        check_conditions(norm, vocabulary, scene, table.place)
    except VocabularyError as error:
        raise WorldFileError(str(error)) from None
