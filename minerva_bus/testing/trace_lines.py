"""Messages between members and coordinator as lines of text, for golden traces."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.grammar.events import AnyEvent, single


def trace_line(what: object) -> str:  # noqa: C901
    """A stimulus or an instruction as a line; empty for one without information."""
    match what:
        case s.Send(to, message):
            line = _sent(message)
            return f"{to} ← {line}" if line else ""
        case s.Show(event_type, message):
            return f"observers of {event_type} ← {_sent(message)}"
        case s.Notify(member, text):
            return f"says {member}: {text.strip()}"
        case s.Ready(frame):
            return f"ready for frame {frame}"
        case s.FrameDone():
            record = what.record
            changed = ", ".join(
                f"#{name}: {state}" for name, state in sorted(record.changed.items())
            )
            return f"frame {record.frame} done: {_events(record.events)}; {changed or 'no change'}"
        case s.Ended(reason, figures):
            return f"ended: {reason} {dict(figures) or ''}".rstrip()
        case s.Appeared(member) | s.Vanished(member):
            return f"{member} {type(what).__name__.lower()}"
        case s.Skip(member):
            return f"skip {member}"
        case s.Drain(member):
            return f"drain {member}"
        case s.Abandoned(member):
            return f"{member} is given up"
        case s.Violation(member, reason):
            return f"{member} breaks the protocol: {reason}"
        case s.Publish(event):
            return f"order: {event}"
        case s.End(reason=reason):
            return f"end: {reason}"
        case s.OrderJudged():
            return ""  # The log has a line about orders, and members get the events.
        case s.Begin() | s.Silent() | s.Stopping():
            return type(what).__name__.lower()
        case _:
            return _received(what)


def _sent(message: m.ToMember) -> str:
    match message:
        case m.Sources(publishers):
            pairs = [f"{topic} by {', '.join(who)}" for topic, who in sorted(publishers.items())]
            return f"sources: {'; '.join(pairs)}" if pairs else ""
        case m.Welcome(frame=frame, saved=saved):
            return f"welcome to frame {frame}" + (f", saved {dict(saved)}" if saved else "")
        case m.Refused(reason) | m.Stop(reason):
            return f"{type(message).__name__.lower()}: {reason}"
        case m.TickRequest(frame):
            return f"tick {frame}"
        case m.Fragments(given, dropped):
            lost = f", without {_ids(dropped)}" if dropped else ""
            return f"fragments {_ids(given)}{lost}"
        case m.EvolveRequest(frame, asked, events, visual, _, only):
            whose = f" ({_ids(only)} only)" if only else ""
            return f"evolve {frame} on {', '.join(asked)}{whose}: {_events((*events, *visual))}"
        case m.ViewShown(event_type, frame, sequence, parts, skeleton):
            # A view with a skeleton is a keyframe.
            whole = "all of " if skeleton is not None else ""
            return f"view {frame} of {event_type}, number {sequence}: {whole}{_ids(parts)}"
        case m.Orders(_, events):
            return f"orders: {_events(events)}"
        case m.Repeat(topic):
            return f"repeat {topic}"
        case _:
            return type(message).__name__.lower()


def _received(message: object) -> str:
    match message:
        case m.Hello(member=member):
            return f"{member}: hello, {', '.join(message.roles) or 'nothing'}"
        case m.TickReply(member, frame, events):
            return f"{member}: ticked {frame}: {_events(events)}"
        case m.EvolveReply(member, frame, _, changed, emitted):
            sent = [event for _, events in sorted(emitted.items()) for event in events]
            more = f", emitting {_events(sent)}" if sent else ""
            return f"{member}: evolved {frame}: {_ids(changed)}{more}"
        case m.Emitted(member, events):
            return f"{member}: emitted {_events(events)}"
        case m.Failed(member, frame, problem):
            return f"{member}: failed in frame {frame}: {problem}"
        case m.Resync(member, event_type):
            return f"{member}: resync {event_type}"
        case m.MemberMetrics(member, figures):
            return f"{member} does {dict(figures)}"
        case m.Report(member, figures):
            return f"{member}: report {dict(figures) or ''}".rstrip()
        case m.Leaving(member):
            return f"{member}: leaving"
        case _:
            return str(message)


def _events(events: Iterable[AnyEvent]) -> str:
    return ", ".join(map(str, single(events))) or "no events"


def _ids(names: Iterable[str]) -> str:
    return " ".join(f"#{name}" for name in sorted(names)) or "nothing"
