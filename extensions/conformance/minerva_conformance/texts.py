"""Messages as texts that are equal exactly if the messages mean the same.

A host may send a changed population as columns, as a patch or as single nodes, so replies are
compared after they are applied to the state of the coordinator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import PART
from minerva_bus.grammar.columns import Delta, packed, patched
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import AgentKind
from minerva_bus.wire.field_codecs import plain_reading


class KnownState:
    """The coordinator's state of a member: its fragments, and its last views."""

    def __init__(self) -> None:
        self.fragments: dict[str, Scene] = {}
        self._views: dict[tuple[str, str], Scene] = {}

    def sent(self, message: m.ToMember) -> None:
        """Note what a message has changed."""
        if isinstance(message, m.Welcome):
            self.fragments, self._views = {}, {}
        elif isinstance(message, m.Fragments):
            for fragment in (*message.dropped, *message.given):
                self._forget(fragment)
            self.fragments |= message.given

    def _forget(self, fragment: str) -> None:
        self.fragments.pop(fragment, None)
        self._views = {key: view for key, view in self._views.items() if key[1] != fragment}

    def evolved(self, reply: m.EvolveReply) -> str:
        """A host's reply as text. Raises Unfit for a patch that does not fit."""
        changed = _applied(self.fragments, reply.changed)
        lines = [f"evolved {reply.frame} part {reply.part}"]
        lines += self._changed(changed)
        lines += _emitted(reply.emitted)
        for event_type, views in sorted(reply.views.items()):
            lines += self._shown(event_type, views)
        return "\n".join(lines)

    def _changed(self, changed: Mapping[str, Scene]) -> list[str]:
        lines: list[str] = []
        for fragment, scene in sorted(changed.items()):
            # A part whose agents have not changed may be sent as well: columns are not compared.
            if not fragment.startswith(PART) or scene != self.fragments.get(fragment):
                lines.append(f"changed {fragment}: {scene}")
            if _is_kept(fragment, scene):
                self.fragments[fragment] = scene
            else:
                self._forget(fragment)
        return lines

    def _shown(self, event_type: str, views: m.Changes) -> list[str]:
        known = {
            fragment: view for (shown, fragment), view in self._views.items() if shown == event_type
        }
        lines: list[str] = []
        for fragment, view in sorted(_applied(known, views).items()):
            if not fragment.startswith(PART) or view != known.get(fragment):
                lines.append(f"view {event_type} {fragment}: {view}")
            self._views[event_type, fragment] = view
        return lines


def text_of(message: m.FromMember | m.Readings, state: KnownState, figures: Iterable[str]) -> str:
    """A member's message as text; `figures` are the names of those that count in a report."""
    match message:
        case m.Hello():
            return _hello(message)
        case m.TickReply():
            return f"ticked {message.frame}: {_events(message.events)}"
        case m.EvolveReply():
            try:
                return state.evolved(message)
            except Unfit as unfit:
                return f"evolved {message.frame}: {unfit}"
        case m.Emitted():
            return f"emitted: {_events(message.events)}"
        case m.Readings():
            readings = [plain_reading(reading) for reading in message.readings]
            return f"readings {message.topic} {message.frame}: {readings}"
        case m.Report():
            shown = {name: _figure(message.figures.get(name)) for name in sorted(figures)}
            return f"report {shown}"
        case m.Resync():
            return f"resync {message.event_type}"
        case m.Failed():
            return f"failed in frame {message.frame}: {message.problem[:200]}"
        case _:
            return type(message).WIRE.name


def _figure(value: float | str | bool | None) -> float | str | bool | None:
    """A figure; a whole number as an integer, because both stand for the same number (P8.6)."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _hello(hello: m.Hello) -> str:
    """What the role determines; topics, orders and columns are optional."""
    kinds = [_kind(kind) for kind in hello.kinds]
    return (
        f"hello version {hello.version}: kinds {kinds}, generates {sorted(hello.generates)},"
        f" when {str(hello.when)!r}, draws {sorted(hello.draws)},"
        f" coupled {hello.coupled}"
    )


def _kind(kind: AgentKind) -> str:
    fields = ", ".join(f"{field.name} {field.type}" for field in kind.fields.all)
    subscribed = [f"{name} {kind.chance(name)}" for name in sorted(kind.subscribes)]
    return f"{kind.name}<{fields}> {subscribed} {sorted(kind.views)}"


def _events(events: Iterable[AnyEvent]) -> str:
    return ", ".join(str(event) for event in single(events)) or "no events"


def _emitted(emitted: m.SentBy) -> list[str]:
    """Events by the agent that sent them: those of a part may be under its name."""
    by_sender: dict[str, list[str]] = {}
    for events in emitted.values():
        for event in single(events):
            by_sender.setdefault(event.sender, []).append(str(event))
    return [f"emitted {sender}: {', '.join(sent)}" for sender, sent in sorted(by_sender.items())]


def _applied(known: Mapping[str, Scene], changes: m.Changes) -> dict[str, Scene]:
    return {name: _after(name, known.get(name), change) for name, change in changes.items()}


def _after(name: str, old: Scene | None, change: Scene | Delta) -> Scene:
    if isinstance(change, Scene):
        return change
    if old is None or len(packed(old).pieces) != 1:
        raise Unfit(f"a patch of {name}, which is not in columns")
    return Scene((patched(packed(old).pieces[0], change),))


def _is_kept(fragment: str, scene: Scene) -> bool:
    """Whether a host keeps the result of a fragment (P9.8, P9.9)."""
    if fragment.startswith(PART):
        return bool(scene.pieces)
    (node,) = scene.pieces if len(scene.pieces) == 1 else (None,)
    return isinstance(node, AgentNode) and node.id == fragment
