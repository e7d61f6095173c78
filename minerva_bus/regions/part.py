"""What a region reports after a frame: how its part of the string has changed, and its events."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.messages import Parts, Patches
from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.frame.schema import Note, Wire, Within
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.delta import Delta, difference, patched
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.scene import EMPTY, Piece, Scene
from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.messages import checked_counts, placed_events
from minerva_bus.regions.norms import NO_REPORT, NormReport
from minerva_bus.regions.place_table import Place, joined
from minerva_bus.regions.places import packed_places, unpacked_places
from minerva_bus.regions.progress import Progress

_INDEX: Final = np.dtype("<i4")
_REGION: Final = np.dtype("<u2")
NEW: Final = -1


@dataclass(frozen=True, slots=True)
class PartMessage:
    """A region's report to the coordinator of the world, as bytes in the data of its `ticked`."""

    WIRE: ClassVar = Wire(
        "part",
        ("from",),
        "what has changed in a region, in the saved data of its `ticked`",
        max_bytes="answer_bytes",
        max_values="region_values",
        max_rows="answer_rows",
        awaited=True,
    )

    frame: int
    kept: Annotated[
        bytes,
        Note(
            "for each piece of its string after the frame, as int32: the number of the same or"
            " patched piece before it, or -1"
        ),
    ]
    changed: Annotated[
        Parts, Note("by the number of its first one, each run of pieces that are new")
    ]
    patched: Annotated[Patches, Within("changed")]
    places: Annotated[bytes, Note("of all nodes of its string, empty if they are unchanged")]
    events: Annotated[tuple[AnyEvent, ...], Note("that its agents have sent")]
    senders: Annotated[bytes, Note("the places of the senders of `events`")]
    resting: Annotated[bool, Note("its next frame would change nothing")]
    reached: Annotated[tuple[str, ...], Note("agents that have sent `until` in this frame")]
    given_up: Annotated[
        m.Figures,
        Note("agents that have given up in this frame, with `give_up` as text"),
    ]
    striving: Annotated[tuple[str, ...], Note("the kinds of agents that have sent either")]
    parcels: Annotated[bytes, Note("the regions to which it has sent one, as uint16")]
    inputs: Annotated[
        bytes,
        Note(
            "of region 0: the events of generators, as an entry of a record (section 12); of the"
            " others: those of services with a halo, for agents of the region"
        ),
    ]
    rejected: Annotated[bytes, Note("the numbers of those `events` that norms reject, as int32")]
    counts: Annotated[
        m.Saved,
        Note("what norms have counted before they judged `events`; nil: as in the last report"),
    ]
    sanctions: Annotated[tuple[AnyEvent, ...], Note("of norms, for the next frame")]
    halted: Annotated[tuple[str, ...], Note("agents whose actions no device executes")]
    answered: Annotated[
        m.Saved,
        Note("by service with a halo, the places of the receivers of its events in `inputs`"),
    ] = None
    for_all: Annotated[
        bytes,
        Note("a `parcel` with those `events` for the next frame that all regions need, or empty"),
    ] = b""


@dataclass(frozen=True, slots=True)
class PartCodec:
    """Coding of reports as bytes. Raises ProtocolError.

    `decode` gets a report, and the agents for which it may have more than the limits. `saved`
    decodes the reports of a journal, and `inputs` the events of generators in reports.
    """

    encode: Callable[[PartMessage], bytes]
    decode: Callable[[bytes, OwnAgents], PartMessage]
    saved: Callable[[bytes], PartMessage]
    inputs: Callable[[bytes], FrameInputs]


@dataclass(slots=True)
class PartSender:
    """The region's side: makes messages from the states of its part after each frame."""

    pieces: tuple[Piece, ...] = ()
    places: Sequence[Place] = ()
    counts: Mapping[str, Any] | None = None

    def message(
        self,
        frame: int,
        units: Units,
        sent: Sequence[PlacedEvent],
        progress: Progress,
        targets: Sequence[int],
        inputs: bytes,
        norms: NormReport = NO_REPORT,
        answered: m.Saved = None,
        for_all: bytes = b"",
    ) -> PartMessage:
        """The message after a frame, relative to that of the frame before."""
        kept, changed, patches = _changes(self.pieces, units.pieces)
        same = units.places == self.places
        places = b"" if same else packed_places(units.places)
        self.pieces, self.places = units.pieces, units.places
        counts = None if norms.counts == self.counts else norms.counts
        self.counts = norms.counts
        return PartMessage(
            frame,
            np.array(kept, _INDEX).tobytes(),
            changed,
            patches,
            places,
            tuple(each.event for each in sent),
            packed_places(joined(each.places for each in sent)),
            progress.resting,
            tuple(sorted(progress.reached)),
            dict(progress.given_up),
            tuple(sorted(progress.striving)),
            np.array(targets, _REGION).tobytes(),
            inputs,
            np.array(norms.rejected, _INDEX).tobytes(),
            counts,
            norms.sanctions,
            norms.halted,
            answered,
            for_all,
        )


@dataclass(slots=True)
class PartReceiver:
    """The coordinator's side: the part of one region, and its last report.

    `targets` are the regions to which it has sent parcels, `sent` the events of its agents that
    norms permit, `unjudged` all of them, and `for_all` what all regions need, as its report has it.
    """

    units: Units
    resting: bool = False
    targets: tuple[int, ...] = ()
    sent: list[PlacedEvent] = field(default_factory=list[PlacedEvent])
    unjudged: list[PlacedEvent] = field(default_factory=list[PlacedEvent])
    norms: NormReport = NO_REPORT
    for_all: bytes = b""

    def apply(self, message: PartMessage) -> None:
        """Continue with the part after a frame. Raises ProtocolError if the message is invalid."""
        before, targets = self.units.pieces, targets_of(message)
        if len(message.kept) % _INDEX.itemsize:
            raise ProtocolError("part: kept must be a list of int32")
        numbers = np.frombuffer(message.kept, _INDEX)
        kept: list[int] = numbers.tolist()
        if kept and not NEW <= numbers.min() <= numbers.max() < len(before):
            raise ProtocolError(f"part: kept must be from -1 to {len(before) - 1}")
        pieces = tuple(_pieces(message, kept, before))
        count = sum(piece.count for piece in pieces)
        places = self.units.places
        if message.places or not count:
            places = unpacked_places(message.places, count, "places")
        if len(places) != count:
            raise ProtocolError(f"part: expected places of {count} nodes, got {len(places)}")
        self.unjudged = [*placed_events(message.events, message.senders)]
        rejected = _rejected(message, len(self.unjudged))
        self.sent = [event for number, event in enumerate(self.unjudged) if number not in rejected]
        counts = self.norms.counts if message.counts is None else checked_counts(message.counts)
        self.norms = NormReport(tuple(rejected), counts, message.sanctions, message.halted)
        self.units, self.resting = Units(places, pieces), message.resting
        self.targets = targets
        self.for_all = message.for_all


def targets_of(message: PartMessage) -> tuple[int, ...]:
    """The regions to which one has sent parcels. Raises ProtocolError for other data."""
    if len(message.parcels) % _REGION.itemsize:
        raise ProtocolError("part: parcels must be a list of uint16")
    return tuple(np.frombuffer(message.parcels, _REGION).tolist())


def _rejected(message: PartMessage, events: int) -> Collection[int]:
    """The numbers of the rejected events, in ascending order. Raises ProtocolError."""
    if len(message.rejected) % _INDEX.itemsize:
        raise ProtocolError("part: rejected must be a list of int32")
    numbers: list[int] = np.frombuffer(message.rejected, _INDEX).tolist()
    if not {*range(events)}.issuperset(numbers):
        raise ProtocolError(f"part: rejected has numbers of none of {events} events")
    return dict.fromkeys(sorted(numbers))


def _pieces(message: PartMessage, kept: Sequence[int], before: Sequence[Piece]) -> Iterator[Piece]:
    """The pieces of a part after a frame. Raises ProtocolError."""
    new: list[Piece] = []
    for position, number in enumerate(kept):
        if number == NEW:
            given = None if new else message.changed.get(str(position))
            new = new or [*(EMPTY if given is None else given).pieces[::-1]]
            if not new:
                raise ProtocolError(f"part: piece {position} must be given")
            yield new.pop()
            continue
        _check_end(new, position)
        yield _patched(before[number], message.patched.get(str(position)), position)
    _check_end(new, len(kept))


def _check_end(new: Sequence[Piece], position: int) -> None:
    if new:
        raise ProtocolError(f"part: {len(new)} more pieces are given than are new at {position}")


def _patched(old: Piece, delta: Delta | None, position: int) -> Piece:
    try:
        return old if delta is None else patched(old, delta)
    except Unfit as unfit:
        raise ProtocolError(f"part: piece {position}: {unfit}") from None


def _changes(
    old: Sequence[Piece], new: Sequence[Piece]
) -> tuple[list[int], dict[str, Scene], dict[str, Delta]]:
    """Numbers of the kept or patched pieces, the runs of new ones, and the patches, by position."""
    numbers = {id(piece): number for number, piece in enumerate(old)}
    kept = [numbers.get(id(piece), NEW) for piece in new]
    used = set(kept)
    free = [n for n, piece in enumerate(old) if n not in used and isinstance(piece, Columns)]
    runs: dict[int, list[Piece]] = {}
    first = NEW
    patches: dict[str, Delta] = {}
    for position, piece in enumerate(new):
        if kept[position] != NEW:
            first = NEW
            continue
        number = _counterpart(old, free, piece)
        delta = None if number is None else difference(old[number], piece)
        if number is None or delta is None:
            first = position if first == NEW else first
            runs.setdefault(first, []).append(piece)
            continue
        free.remove(number)
        kept[position], first = number, NEW
        patches[str(position)] = delta
    return kept, {str(at): Scene(tuple(run)) for at, run in runs.items()}, patches


def _counterpart(old: Sequence[Piece], free: Sequence[int], piece: Piece) -> int | None:
    """The number of the first free piece of the same shape."""
    if not isinstance(piece, Columns):
        return None
    return next((n for n in free if getattr(old[n], "shape", None) == piece.shape), None)
