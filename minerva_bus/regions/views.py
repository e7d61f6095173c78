"""Views of regions: parts of the view of a whole string, and their assembly at its devices."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from minerva_bus.errors import WorldStopped
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.fragments import PART
from minerva_bus.frame.in_flight import FrameInFlight
from minerva_bus.frame.messages import Parts, Patches, ViewShown
from minerva_bus.frame.views import patch_all
from minerva_bus.grammar.packing import size
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene, agents
from minerva_bus.regions.merging import Merger, Units
from minerva_bus.regions.place_table import Place, joined
from minerva_bus.regions.places import spans


@dataclass(frozen=True, slots=True)
class PlacedSkeleton:
    """A region's string without its agents.

    `skeleton` has a slot for each fragment, `sizes` the number of nodes of each of its pieces or of
    the fragment there, and `places` the places of all these nodes.
    """

    skeleton: Scene = EMPTY
    sizes: tuple[int, ...] = ()
    places: Sequence[Place] = ()

    @classmethod
    def of(cls, composition: Composition, places: Sequence[Place]) -> PlacedSkeleton:
        """The layout of a composition whose nodes have these places."""
        sizes = tuple([end - begin for _, _, begin, end in spans(composition)])
        return cls(composition.skeleton, sizes, places)

    def each(self) -> Iterator[tuple[Piece, Sequence[Place]]]:
        """Each piece with the places of its nodes."""
        end = 0
        for piece, count in zip(self.skeleton.pieces, self.sizes, strict=True):
            begin, end = end, end + count
            yield piece, self.places[begin:end]


@dataclass(frozen=True, slots=True)
class ViewPart:
    """The views of a region's part of w in one frame, by visual event type and fragment.

    They are changed views, whole or as patches of the last ones. `layout` is None if it has not
    changed since the last part. `halted`: agents whose actions devices must not execute.
    """

    views: Mapping[str, Parts] = field(default_factory=dict[str, Parts])
    patches: Mapping[str, Patches] = field(default_factory=dict[str, Patches])
    layout: PlacedSkeleton | None = None
    halted: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        """Whether any view is due in the frame."""
        return bool(self.views)


NO_VIEWS = ViewPart()


@dataclass(slots=True)
class RegionViews:
    """The latest views of a region, by event type and fragment."""

    layout: PlacedSkeleton = field(default_factory=PlacedSkeleton)
    views: dict[str, dict[str, Scene]] = field(default_factory=dict[str, dict[str, Scene]])
    halted: tuple[str, ...] = ()

    def part(self, types: Iterable[str]) -> ViewPart:
        """The views of these event types, as the part of a region that has sent none before."""
        return ViewPart(
            {name: {**self.views.get(name, {})} for name in types}, {}, self.layout, self.halted
        )

    def take(self, part: ViewPart) -> None:
        """Continue with the views of a frame."""
        self.halted = part.halted
        if part.layout is not None:
            self.layout = part.layout
            slots = {slot.id for slot in agents(part.layout.skeleton)}
            self.views = {
                event_type: {name: view for name, view in of.items() if name in slots}
                for event_type, of in self.views.items()
            }
        for event_type, changed in part.views.items():
            of = self.views.setdefault(event_type, {})
            of.update(changed)
            patch_all(of, part.patches.get(event_type, {}))


class PartialViews:
    """The views that a region sends to the region of its devices: those of some event types.

    While it `repeats` the frames of a former process, and in the first view of each type that it
    sends itself, views are whole: agents in columns may have other fragments than in the former
    process, whose views others have.
    """

    def __init__(self, drawn: Collection[str] = ()) -> None:
        self.repeats = False
        self._drawn = drawn
        self._layout: PlacedSkeleton | None = None
        self._unsent = {*drawn}
        self._views = RegionViews()

    def part(
        self, in_flight: FrameInFlight, composition: Composition, places: Sequence[Place]
    ) -> ViewPart:
        """The part of a frame whose results are final, before they replace the string."""
        visual = {event.type for event in in_flight.events.visual}
        types = sorted(visual.intersection(self._drawn))
        if not types:
            return NO_VIEWS
        layout, result = PlacedSkeleton.of(composition, places), in_flight.result
        changed = self._layout != layout
        self._layout = layout
        changes = ViewPart(
            {name: result.views.get(name, {}) for name in types},
            {name: result.view_patches[name] for name in types if name in result.view_patches},
            layout if changed else None,
            result.halted,
        )
        if not self._unsent:
            return changes
        self._views.take(changes)
        part = changes if self._unsent.isdisjoint(types) else self._views.part(types)
        if not self.repeats:
            self._unsent.difference_update(types)
        return part


class ViewAssembly:
    """The views of the whole string, assembled from those of all regions.

    `sequence` is the number of the last view before them.
    """

    def __init__(self, sequence: int = 0) -> None:
        self._regions: dict[int, RegionViews] = {}
        self._skeletons: dict[str, tuple[Scene, dict[str, Scene]]] = {}
        self._frames: dict[str, int] = {}
        self._sequence = sequence

    @property
    def parts(self) -> dict[int, dict[int, ViewPart]]:
        """The latest views by frame and region; assembled in this order they make this one."""
        return {
            frame: {
                number: region.part(name for name, of in self._frames.items() if of == frame)
                for number, region in self._regions.items()
            }
            for frame in sorted(set(self._frames.values()))
        }

    def assemble(self, frame: int, parts: Mapping[int, ViewPart]) -> list[ViewShown]:
        """The views of a frame, whole, from the parts of all regions by number.

        Raises WorldStopped if nothing shows which agents have made which nodes of a view.
        """
        for number, part in sorted(parts.items()):
            self._regions.setdefault(number, RegionViews()).take(part)
            self._forget_skeletons(part)
        types = sorted({event_type for part in parts.values() for event_type in part.views})
        halted = tuple(sorted({who for part in parts.values() for who in part.halted}))
        self._sequence += 1
        self._frames.update(dict.fromkeys(types, frame))
        return [self._whole(event_type, frame, halted) for event_type in types]

    def _forget_skeletons(self, part: ViewPart) -> None:
        if part.layout is not None:
            self._skeletons.clear()
        # The rows of agents in columns of different regions alternate.
        for event_type, views in part.views.items():
            if part.patches.get(event_type) or any(name.startswith(PART) for name in views):
                self._skeletons.pop(event_type, None)

    def _whole(self, event_type: str, frame: int, halted: tuple[str, ...]) -> ViewShown:
        parts: dict[str, Scene] = {}
        for region in self._regions.values():
            views = region.views.get(event_type, {}).items()
            parts |= {name: view for name, view in views if not name.startswith(PART)}
        known = self._skeletons.get(event_type)
        if known is None:
            known = self._skeletons[event_type] = self._skeleton(event_type)
        skeleton, columns = known
        parts |= columns
        return ViewShown(event_type, frame, self._sequence, parts, skeleton, halted=halted)

    def _skeleton(self, event_type: str) -> tuple[Scene, dict[str, Scene]]:
        """Static parts and slots, and what the agents in columns show, by slot."""
        placed = [placed_views(region, event_type) for region in self._regions.values()]
        kinds, merger = [kind for each in placed for kind in each.kinds], Merger()
        units = merger.merge([each.units for each in placed], kinds)
        pieces, parts = list[Piece](), dict[str, Scene]()
        for piece, kind in zip(units.pieces, merger.kinds, strict=True):
            if not kind:
                pieces.append(piece)
                continue
            name = f"{PART}{kind}.{len(parts)}"
            parts[name] = Scene((piece,))
            pieces.append(AgentNode(kind, name))
        return Scene(tuple(pieces)) if pieces else EMPTY, parts


@dataclass(frozen=True, slots=True)
class PlacedViews:
    """The slots of a region, and what its agents in columns show.

    `kinds` has the kind of the agents in columns for each piece of `units`, "" for the others.
    """

    units: Units
    kinds: Sequence[str]


def placed_views(region: RegionViews, event_type: str) -> PlacedViews:
    """What a region shows for an event type, by place."""
    views, pieces = region.views.get(event_type, {}), list[Piece]()
    places = list[Sequence[Place]]()
    kinds: list[str] = []
    for piece, own in region.layout.each():
        if not (isinstance(piece, AgentNode) and piece.id.startswith(PART)):
            places.append(own)
            pieces.append(piece)
            kinds.append("")
            continue
        shown = views.get(piece.id, EMPTY).pieces
        if shown and size(shown) != len(own):
            raise WorldStopped(
                f"regions: {len(own)} agents of the kind {piece.symbol}, held in columns, show"
                f" {size(shown)} nodes for {event_type}; expected one node of each agent, or run"
                " this world without regions"
            )
        places.append(own if shown else ())
        pieces += shown
        kinds += [piece.symbol] * len(shown)
    return PlacedViews(Units(joined(places), tuple(pieces)), kinds)
