"""A host of agents: evolves and visualizes the fragments that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.composition import Fragment, fragment_in
from minerva_bus.frame.messages import EvolveReply, EvolveRequest, Fragments
from minerva_bus.grammar.columns import has_columns, size
from minerva_bus.grammar.delta import Delta, difference
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import RowDelta, row_delta_of_ids
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.addressing import Addressed
from minerva_bus.world.agent import Agent, Kinds
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Evolved, Policy, evolve
from minerva_bus.world.visualization import visualize

_TYPE: Final = attrgetter("type")


@dataclass(slots=True)
class _Different:
    """Changed fragments or views: whole, or as deltas."""

    changed: dict[str, Scene] = field(default_factory=dict[str, Scene])
    patched: dict[str, Delta] = field(default_factory=dict[str, Delta])


@dataclass(frozen=True, slots=True)
class _Shown:
    """A view with its fragment and events, which determine it (equation 4)."""

    piece: Fragment
    events: tuple[AnyEvent, ...]
    view: Scene


class Host:
    """Steps 5 and 6 of Table 2 for the fragments of one host."""

    def __init__(self, name: str, kinds: Mapping[str, type[Agent]]) -> None:
        self.name = name
        self.kinds: Kinds = kinds
        self.fragments: dict[str, Fragment] = {}
        self._shown: dict[tuple[str, str], _Shown] = {}

    def clear(self) -> None:
        """Drop all fragments."""
        self.fragments, self._shown = {}, {}

    def take(self, given: Fragments) -> None:
        """Store given fragments and drop others. Raises ProtocolError."""
        for fragment in given.dropped:
            self._drop(fragment)
        for fragment, scene in given.given.items():
            # `_drop` also forgets the views, because the coordinator
            # expects whole ones of a given fragment.
            self._drop(fragment)
            piece = fragment_in(scene, fragment)
            if piece is None:
                raise ProtocolError(f"the fragment #{fragment} is not an agent of that name")
            self.fragments[fragment] = piece

    def _drop(self, fragment: str) -> None:
        self.fragments.pop(fragment, None)
        for key in [key for key in self._shown if key[1] == fragment]:
            del self._shown[key]

    def answer(
        self, request: EvolveRequest, frame: Frame, policy: Policy, vocabulary: Vocabulary
    ) -> EvolveReply:
        """η and π over the fragments that a request concerns. Raises ProtocolError.

        Without events agents keep their state, unless the policy says otherwise.
        """
        concerned = request.only or tuple(self.fragments)
        # Checked before anything evolves, since a fragment may evolve only once in a frame.
        for name in concerned:
            if name not in self.fragments:
                raise ProtocolError(f"frame {request.frame} is about #{name}, never given here")
        views: dict[str, dict[str, Scene]] = {}
        view_patches: dict[str, dict[str, Delta]] = {}
        # Views are first: they show the string before the evolution, which replaces the fragments.
        for event_type in sorted(set(map(_TYPE, request.visual))):
            shown = self._views(event_type, concerned, request.visual, frame)
            views[event_type] = shown.changed
            if shown.patched:
                view_patches[event_type] = shown.patched
        events = Addressed(request.events)
        results = _Different()
        emitted: dict[str, tuple[AnyEvent, ...]] = {}
        evolving = bool(request.events) or policy.rules.without_events
        for fragment in concerned if evolving else ():
            was = Scene((self.fragments[fragment],))
            result = evolve(was, events, self.kinds, frame, policy)
            if result.emitted or result.batches:
                emitted.update(_checked(fragment, result, vocabulary))
            # Evolution shares unchanged objects, so identity detects changes without a comparison.
            if result.scene is not was:
                now = vocabulary.check(result.scene, f"#{fragment}")
                self._changed(fragment, was, now, results)
        return EvolveReply(
            self.name,
            request.frame,
            request.part,
            results.changed,
            emitted,
            views,
            results.patched,
            view_patches,
        )

    def _changed(self, fragment: str, was: Scene, scene: Scene, results: _Different) -> None:
        """Store a fragment's result; one with newborns returns from the coordinator when placed."""
        patch = _patch(was, scene)
        if patch is None:
            results.changed[fragment] = scene
        else:
            results.patched[fragment] = patch
        now = fragment_in(scene, fragment)
        if now is None:
            self._drop(fragment)
        else:
            self.fragments[fragment] = now

    def _views(
        self, event_type: str, concerned: Sequence[str], visual: Sequence[AnyEvent], frame: Frame
    ) -> _Different:
        """The views for one event type that differ from the last ones.

        The first view of a fragment always counts as changed, even if it is ε, because its view on
        its former host is unknown here.
        """
        events = Addressed(tuple([event for event in visual if event.type == event_type]))
        views = _Different()
        for fragment in concerned:
            piece, shown = self.fragments[fragment], self._shown.get((event_type, fragment))
            if shown is not None and shown.piece is piece and shown.events == events.events:
                continue
            view = visualize(Scene((piece,)), events, self.kinds, frame.number)
            # Stored even if the view has not changed: the next
            # frame compares fragments by identity.
            self._shown[event_type, fragment] = _Shown(piece, events.events, view)
            patch = _view_patch(shown, piece, view) if shown is not None else None
            # An empty patch means that the fragment has changed and its
            # view has not, so nothing is sent.
            if patch is not None and not patch.empty:
                views.patched[fragment] = patch
            elif patch is None and (shown is None or _other(shown.view, view)):
                views.changed[fragment] = view
        return views


def _other(old: Scene, new: Scene) -> bool:
    """Whether two views without a common delta differ; columns always do, to avoid a digest."""
    return has_columns(new) or old != new


def _patch(old: Scene, new: Scene, row_delta: RowDelta | None = None) -> Delta | None:
    """Delta between two strings, if each is one piece in columns with rows in the same order."""
    if len(old.pieces) != 1 or len(new.pieces) != 1:
        return None
    return difference(old.pieces[0], new.pieces[0], row_delta)


def _view_patch(shown: _Shown, piece: Fragment, view: Scene) -> Delta | None:
    """Delta between two views; rows were added and removed as in the fragment they show."""
    old, new = shown.piece, piece
    row_delta = None
    if old.ids is not None and new.ids is not None:
        # Only if each agent has exactly one piece of view do the rows of both correspond.
        whole = size(shown.view.pieces) == old.count and size(view.pieces) == new.count
        if old.ids is not new.ids and whole:
            row_delta = row_delta_of_ids(old.ids, new.ids)
    return _patch(shown.view, view, row_delta)


def _checked(
    fragment: str, result: Evolved, vocabulary: Vocabulary
) -> dict[str, tuple[AnyEvent, ...]]:
    """Checked events: by agent, or by fragment for agents in columns."""
    sent: dict[str, tuple[AnyEvent, ...]] = {
        agent: tuple([vocabulary.check_event(event, f"#{agent}") for event in events])
        for agent, events in result.emitted.items()
    }
    if result.batches:
        sent[fragment] = tuple([vocabulary.check_any(event, fragment) for event in result.batches])
    return sent
