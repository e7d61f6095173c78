"""What makes one string of another: how a record holds the strings of all frames.

    edit  = [step, ...]                  along the pieces of the old string
    step  = n                            the next n pieces stay
          | -n                           the next n pieces go
          | string                       these pieces come (protocol/values.py)
          | patch                        the next piece, in columns, is changed (columns.py)
          | {"scope": edit}              the next piece stays, with another scope

Pieces behind the last step stay. Fragments have names, but only their coordinator knows which
parts of a population the names stand for at a time; places in the string need nobody to ask.

Both strings share what has not changed, so identity tells; comparing never goes into it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Hashable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, cast

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.patch import difference, patched
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Piece,
    Scene,
    with_scope,
)
from minerva_bus.wire.columns import is_patch, plain_patch
from minerva_bus.wire.plain import as_list
from minerva_bus.wire.values import Reader, plain_scene

Edit = list[Any]

DEEPEST: Final = 32
"""Scopes within scopes that are edited; below that, all of a scope comes anew."""


# --- making edits ---


def edit_between(old: Scene, new: Scene, depth: int = 0) -> Edit:
    """The edit that makes the new string of the old one."""
    before, after = old.pieces, new.pieces
    same = _same_ahead(before, after)
    counterpart = _counterparts(before, after, same)
    steps = _Steps(same)
    for piece, place in zip(islice(after, same, None), counterpart, strict=True):
        if place < steps.at:
            steps.come.append(piece)
            continue
        steps.go_to(place)
        if before[place] is piece:
            steps.stay()
        else:
            steps.change(_changed(before[place], piece, depth), piece)
    steps.go_to(len(before))
    return steps.done()


def _counterparts(before: Sequence[Piece], after: Sequence[Piece], same: int) -> Iterator[int]:
    """For each new piece the place of the old one that it is, or was, or -1."""
    if len(before) == len(after) and all(
        map(_alike, islice(before, same, None), islice(after, same, None))
    ):
        yield from range(same, len(after))  # As nearly always: nobody has come or gone.
        return
    here = {id(piece): place for place, piece in enumerate(before) if place >= same}
    kept = here.keys() & map(id, islice(after, same, None))
    was = dict(zip(_keys(before, same, kept), range(same, len(before)), strict=True))
    for key, piece in zip(_keys(after, same, kept), islice(after, same, None), strict=True):
        place = here.get(id(piece), -1)
        yield place if place >= 0 else was.get(key, -1)


class _Steps:
    """Steps in the making, and how far in the old string they have come."""

    def __init__(self, same: int) -> None:
        self.at = same
        self.come: list[Piece] = []
        self._made: Edit = []
        self._stay, self._gone = same, 0

    def stay(self) -> None:
        """The next piece stays."""
        if self._gone or self.come:
            self._put_down()
        self._stay += 1
        self.at += 1

    def go_to(self, place: int) -> None:
        """The pieces before this place go."""
        self._gone += place - self.at
        self.at = place

    def change(self, step: Any, piece: Piece) -> None:
        """The next piece is changed by this step; None: the other one comes for it."""
        if step is None:
            self.come.append(piece)
            self._gone += 1
        else:
            self._put_down()
            self._made.append(step)
        self.at += 1

    def done(self) -> Edit:
        """All steps."""
        if self._gone or self.come:
            self._put_down()
        return self._made

    def _put_down(self) -> None:
        come = [plain_scene(Scene(tuple(self.come)))] if self.come else []
        self._made += [step for step in (self._stay, -self._gone) if step]
        self._made += come
        self._stay, self._gone, self.come = 0, 0, []


def _same_ahead(before: Sequence[Piece], after: Sequence[Piece]) -> int:
    """How many pieces at the beginning are the very same."""
    shorter = min(len(before), len(after))
    if before is after:
        return shorter
    pairs = zip(before, after, strict=False)
    return next((place for place, (one, two) in enumerate(pairs) if one is not two), shorter)


def _alike(old: Piece, new: Piece) -> bool:
    """Whether these are the same piece, or the same agent or symbol, changed."""
    if old is new:
        return True
    if isinstance(old, AgentNode) and isinstance(new, AgentNode):
        return old.id == new.id
    return type(old) is type(new) and old.symbol == new.symbol


def _keys(pieces: Sequence[Piece], begin: int, kept: Container[int]) -> Iterator[Hashable]:
    """What each piece is known by: an agent's id, or its symbol and which of them it is.

    Those that are in both strings as they are do not count.
    """
    seen: Counter[str] = Counter()
    for piece in islice(pieces, begin, None):
        if id(piece) in kept:
            yield None
        elif isinstance(piece, AgentNode):
            yield piece.id
        else:
            seen[piece.symbol] += 1
            yield piece.symbol, seen[piece.symbol]


def _changed(old: Piece, new: Piece, depth: int) -> Any:
    """The step that makes the new piece of the old one; None where it has to come anew."""
    if type(old) is AgentNode and type(new) is AgentNode and old.values is not new.values:
        return None  # As most changes are.
    if isinstance(old, Columns):
        patch = difference(old, new) if isinstance(new, Columns) else None
        return None if patch is None else plain_patch(patch)
    if isinstance(old, FigureNode) or isinstance(new, Columns | FigureNode) or depth >= DEEPEST:
        return None
    if type(old) is not type(new) or old.symbol != new.symbol or old.values is not new.values:
        return None
    return {"scope": edit_between(old.scope, new.scope, depth + 1)}


# --- carrying them out ---


def edited(old: Scene, plain: Any, reader: Reader, depth: int = 0) -> Scene:
    """The new string. Raises ProtocolError and VocabularyError where the edit is none of it."""
    if depth > DEEPEST:
        raise ProtocolError(f"an edit goes more than {DEEPEST} scopes deep")
    steps = as_list(plain, "an edit")
    if not steps:
        return old
    left = iter(old.pieces)
    made: list[Piece] = []
    for step in steps:
        if type(step) is int:
            some = _next(left, abs(step))
            made += some if step > 0 else []
        elif is_patch(step):
            made.append(_patched(_next(left, 1)[0], step, reader))
        elif isinstance(step, list):
            made += reader.scene(step).pieces
        else:
            made.append(_rescoped(_next(left, 1)[0], step, reader, depth))
    made += left
    return Scene(tuple(made)) if made else EMPTY


def _next(left: Iterator[Piece], count: int) -> list[Piece]:
    some = list(islice(left, count))
    if not some or len(some) < count:
        raise ProtocolError("an edit goes beyond its string")
    return some


def _patched(piece: Piece, plain: Any, reader: Reader) -> Piece:
    try:
        if isinstance(piece, Columns):
            return patched(piece, reader.columns.patch(plain))
    except (Unfit, IndexError) as error:
        raise ProtocolError(f"a patch does not fit: {error}") from None
    raise ProtocolError("a patch is for columns")


def _rescoped(piece: Piece, step: Any, reader: Reader, depth: int) -> Piece:
    if not isinstance(step, dict) or list(cast("dict[Any, Any]", step)) != ["scope"]:
        raise ProtocolError("a step of an edit is a number, a string, a patch or a scope")
    if isinstance(piece, FigureNode | Columns):
        raise ProtocolError("an edit goes into a piece without a scope")
    edit = cast("dict[str, Any]", step)["scope"]
    return with_scope(piece, edited(piece.scope, edit, reader, depth + 1))
