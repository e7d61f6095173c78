"""Delta between two strings: how a record stores the strings of all frames.

    delta = [step, ...]                  along the pieces of the old string
    step  = n                            keep the next n pieces
          | -n                           remove the next n pieces
          | string                       insert these pieces (wire/strings_codec.py)
          | patch                        change the next piece, in columns (wire/columns_codec.py)
          | {"scope": delta}             keep the next piece with a changed scope

Pieces after the last step stay. A delta refers to positions, not to fragment names, because only
the coordinator knows which rows of a population a name refers to at a given time.

Both strings share unchanged pieces, so identity is compared and never their contents.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Hashable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, cast

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.delta import difference, patched
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene, Scoped, with_scope
from minerva_bus.wire.columns_codec import is_patch, plain_patch
from minerva_bus.wire.plain import as_list
from minerva_bus.wire.strings_codec import Reader, plain_scene

StringDelta = list[Any]

DEEPEST: Final = 32
"""Nested scopes that a delta enters; a changed scope below that is stored as a whole."""


# --- computing a delta ---


def delta_between(old: Scene, new: Scene, depth: int = 0) -> StringDelta:
    """The delta from the old string to the new one."""
    before, after = old.pieces, new.pieces
    same = _same_ahead(before, after)
    counterpart = _counterparts(before, after, same)
    steps = _Steps(same)
    for piece, place in zip(islice(after, same, None), counterpart, strict=True):
        # Its counterpart has been passed, because pieces have
        # changed their order, or there is none.
        if place < steps.at:
            steps.inserted.append(piece)
            continue
        steps.go_to(place)
        if before[place] is piece:
            steps.stay()
        else:
            steps.change(_changed(before[place], piece, depth), piece)
    steps.go_to(len(before))
    return steps.done()


def _counterparts(before: Sequence[Piece], after: Sequence[Piece], same: int) -> Iterator[int]:
    """For each new piece, the position of the old piece it corresponds to, or -1."""
    if len(before) == len(after) and all(
        map(_alike, islice(before, same, None), islice(after, same, None))
    ):
        yield from range(same, len(after))  # The usual case: no piece was added or removed.
        return
    # Shared pieces are matched by identity first, so that they are kept even if others with the
    # same symbol were added before them.
    here = {id(piece): place for place, piece in enumerate(before) if place >= same}
    kept = here.keys() & map(id, islice(after, same, None))
    was = dict(zip(_keys(before, same, kept), range(same, len(before)), strict=True))
    for key, piece in zip(_keys(after, same, kept), islice(after, same, None), strict=True):
        place = here.get(id(piece), -1)
        yield place if place >= 0 else was.get(key, -1)


class _Steps:
    """Collects steps; `at` is the position reached in the old string."""

    def __init__(self, same: int) -> None:
        self.at = same
        self.inserted: list[Piece] = []
        self._made: StringDelta = []
        self._stay, self._gone = same, 0

    def stay(self) -> None:
        """Keep the next piece."""
        if self._gone or self.inserted:
            self._flush()
        self._stay += 1
        self.at += 1

    def go_to(self, place: int) -> None:
        """Remove the pieces before this position."""
        self._gone += place - self.at
        self.at = place

    def change(self, step: Any, piece: Piece) -> None:
        """Change the next piece by this step, or replace it if the step is None."""
        if step is None:
            self.inserted.append(piece)
            self._gone += 1
        else:
            self._flush()
            self._made.append(step)
        self.at += 1

    def done(self) -> StringDelta:
        """Finish and return all steps."""
        if self._gone or self.inserted:
            self._flush()
        return self._made

    def _flush(self) -> None:
        inserted = [plain_scene(Scene(tuple(self.inserted)))] if self.inserted else []
        self._made += [step for step in (self._stay, -self._gone) if step]
        self._made += inserted
        self._stay, self._gone, self.inserted = 0, 0, []


def _same_ahead(before: Sequence[Piece], after: Sequence[Piece]) -> int:
    """Number of identical pieces at the beginning."""
    shorter = min(len(before), len(after))
    if before is after:
        return shorter
    pairs = zip(before, after, strict=False)
    return next((at for at, (old, new) in enumerate(pairs) if old is not new), shorter)


def _alike(old: Piece, new: Piece) -> bool:
    """Whether these are the same piece, or versions of the same agent or symbol."""
    if old is new:
        return True
    if isinstance(old, AgentNode) and isinstance(new, AgentNode):
        return old.id == new.id
    return type(old) is type(new) and old.symbol == new.symbol


def _keys(pieces: Sequence[Piece], begin: int, kept: Container[int]) -> Iterator[Hashable]:
    """Key of each piece: an agent's id, or a symbol and its ordinal.

    Pieces that both strings share have the key None.
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
    """The step from the old piece to the new one; None if the new piece must be inserted."""
    if type(old) is AgentNode and type(new) is AgentNode and old.values is not new.values:
        return None  # The usual change: other attribute values.
    patch = difference(old, new)
    if patch is not None:
        return plain_patch(patch)
    # Bounded, because deltas of scopes are computed and applied recursively.
    if not isinstance(old, Scoped) or not isinstance(new, Scoped) or depth >= DEEPEST:
        return None
    if type(old) is not type(new) or old.symbol != new.symbol or old.values is not new.values:
        return None
    return {"scope": delta_between(old.scope, new.scope, depth + 1)}


# --- applying a delta ---


def apply_delta(old: Scene, plain: Any, reader: Reader, depth: int = 0) -> Scene:
    """The new string. Raises ProtocolError and VocabularyError if the delta does not fit."""
    if depth > DEEPEST:
        raise ProtocolError(f"a delta goes more than {DEEPEST} scopes deep")
    steps = as_list(plain, "a delta")
    if not steps:
        return old
    left = iter(old.pieces)
    made: list[Piece] = []
    for step in steps:
        if type(step) is int:
            # A step beyond the string is an error and not ignored: the delta is for another string.
            passed = _next(left, abs(step))
            made += passed if step > 0 else []
        elif is_patch(step):
            made.append(_patched(_next(left, 1)[0], step, reader))
        elif isinstance(step, list):
            made += reader.scene(step).pieces
        else:
            made.append(_rescoped(_next(left, 1)[0], step, reader, depth))
    made += left
    return Scene(tuple(made)) if made else EMPTY


def _next(left: Iterator[Piece], count: int) -> list[Piece]:
    pieces = list(islice(left, count))
    if not pieces or len(pieces) < count:
        raise ProtocolError("a delta goes beyond its string")
    return pieces


def _patched(piece: Piece, plain: Any, reader: Reader) -> Piece:
    try:
        return patched(piece, reader.columns.patch(plain))
    except (Unfit, IndexError) as error:
        raise ProtocolError(f"a patch does not fit: {error}") from None


def _rescoped(piece: Piece, step: Any, reader: Reader, depth: int) -> Piece:
    if not isinstance(step, dict) or list(cast("dict[Any, Any]", step)) != ["scope"]:
        raise ProtocolError("a step of a delta is a number, a string, a patch or a scope")
    if not isinstance(piece, Scoped):
        raise ProtocolError("a delta enters a piece without a scope")
    delta = cast("dict[str, Any]", step)["scope"]
    return with_scope(piece, apply_delta(piece.scope, delta, reader, depth + 1))
