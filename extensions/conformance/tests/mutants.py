"""Naive members that break one rule each, and the requirements that these breaks concern."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from naive import (
    ROLES,
    Coupled,
    Ended,
    Event,
    Generator,
    Host,
    Invalid,
    NaiveMember,
    Observer,
    Role,
    height,
)


@dataclass(frozen=True)
class Mutant:
    """A way of breaking a member: methods that replace those of its role, or of the member."""

    name: str
    role: type[Role]
    requirements: str
    methods: dict[str, Callable[..., Any]]

    @property
    def role_name(self) -> str:
        """Name of the role."""
        return next(name for name, role in ROLES.items() if role is self.role)

    def kind(self) -> type[NaiveMember]:
        """The class of the broken member."""
        own = {n: f for n, f in self.methods.items() if hasattr(self.role, n)}
        others = {n: f for n, f in self.methods.items() if n not in own}
        assert all(hasattr(NaiveMember, n) for n in others), others
        broken = type(self.role.__name__, (self.role,), own)
        roles = {**ROLES, self.role_name: broken}
        return type("BrokenMember", (NaiveMember,), {**others, "role_classes": roles})


def answer_again(self: Generator, frame: int) -> None:
    self.answers.pop(frame, None)
    Generator.on_tick(self, frame)


def without_orders(self: Generator, frame: int) -> tuple:
    self.orders.clear()
    return Generator.ticked(self, frame)


def in_order_of_arrival(self: Generator, frame: int) -> list:
    keys = [key for key in self.readings if key[0] in (frame, -1)]
    return [distance for key in keys for distance in self.readings.pop(key)]


def forget_saved(self: Generator, welcome: dict, again: bool) -> None:
    Generator.welcome(self, {**welcome, "saved": None}, again)


def float_frame(self: Generator, frame: int) -> tuple:
    _, number, *rest = Generator.ticked(self, frame)
    return ("ticked", int(float(number)), *rest)


def positive_zero(self: Generator, frame: int, events: list) -> None:
    Generator.on_orders(self, frame, [[e[0], [e[1][0] + 0.0], *e[2:]] for e in events])


def bare_orders(self: Generator, frame: int, events: list) -> None:
    Generator.on_orders(self, frame, [event[:2] for event in events])


def leave_and_stay(self: NaiveMember) -> None:
    NaiveMember.leave(self)
    self.send("report", {})


def fail_silently(self: NaiveMember, problem: Exception) -> None:
    raise Ended(1)


def obey_all(self: NaiveMember, epoch: int, name: str) -> bool:
    NaiveMember.follows(self, epoch, name)
    return True


def obey_later(self: NaiveMember, epoch: int, name: str) -> bool:
    self.obeys = self.obeys or name == "greet"
    self.epoch = max(self.epoch, epoch)
    return self.obeys and epoch == self.epoch


def end_silently(self: NaiveMember) -> None:
    raise Ended(0)


def end_well(self: NaiveMember, name: str, *items: Any) -> None:
    if name == "refused":
        raise Ended(0)
    NaiveMember.on_message(self, name, *items)


def keep_token(self: NaiveMember) -> None:
    token, self.token = self.token, None
    NaiveMember.lose(self)
    self.token = token


def keep_obeying(self: NaiveMember) -> None:
    epoch = self.epoch
    NaiveMember.lose(self)
    self.epoch, self.obeys = epoch, True


def do_nothing(*_: Any) -> None:
    return None


def yes(*_: Any) -> bool:
    return True


def no(*_: Any) -> bool:
    return False


def answer_garbage(self: NaiveMember, message: list) -> None:
    try:
        NaiveMember.check(self, message)
    except Invalid:
        self.send("ticked", 0, [], None)
        raise


def subscribe_to_all(self: NaiveMember) -> list[str]:
    return [*NaiveMember.subscriptions(self), "evolve"]


def all_fragments(self: Host, only: list) -> list:
    return list(self.fragments)


def all_views(self: Host, names: list) -> dict:
    return {name: self.view(self.fragments[name]) for name in names}


def keep_views(self: Host, name: str) -> None:
    self.fragments.pop(name, None)


def evolve_first(self: Host, names: list) -> dict:
    # The next total is shown: the events of the frame are not known here, so one is added.
    views = Host.views(self, names)
    return {
        name: [n, *(["PBar", [b[1][0] + 1.0]] for b in bars)] for name, (n, *bars) in views.items()
    }


def to_everyone(self: Host, event: Event, node: list, receiver: str) -> bool:
    event.receivers = []
    return Host.matches(self, event, node, receiver)


def unconditional(self: Host, event: Event, node: list, receiver: str) -> bool:
    event.condition = ""
    return Host.matches(self, event, node, receiver)


def newborn_lives(self: Host, node: list, events: list, receiver: str) -> list:
    agent, *newborn = Host.live(self, node, events, receiver) or [None]
    if agent is not node:
        return [] if agent is None else [agent, *newborn]
    return [node, *(each for child in newborn for each in Host.live(self, child, events, child[1]))]


def without_sender(self: Host, agent: str, event: list) -> None:
    Host.emit(self, agent, [*event[:3], "", event[4]])


def emit_backwards(self: Host, agent: str, event: list) -> None:
    self.emitted.setdefault(agent, []).insert(0, event)


def same_in_each_frame(self: Host, agent: str, *purpose: str) -> Any:
    frame, self.frame = self.frame, 0
    try:
        return Host.stream(self, agent, *purpose)
    finally:
        self.frame = frame


def one_stream(self: Host, agent: str, *purpose: str) -> Any:
    return Host.stream(self, agent)


def begin_again(self: Host, agent: str, *purpose: str) -> Any:
    self.streams.clear()
    return Host.stream(self, agent, *purpose)


def copies_without_frame(
    self: Host, node: list, number: int, tall: int, inner: bool = False
) -> list:
    frame, self.frame = self.frame, 0
    try:
        return Host.copy(self, node, number, tall, inner)
    finally:
        self.frame = frame


def copies_by_depth(
    self: Host, node: list, number: int, tall: int, inner: bool = False, depth: int = 2
) -> list:
    """Counts from the copied agent inwards: right where scopes are one level deep."""
    symbol, agent, values, _ = Host.copy(self, [*node[:3], []], number, depth - 1, inner)
    inside = [copies_by_depth(self, each, number, tall, True, depth + 1) for each in node[3]]
    return [symbol, agent, values, inside]


def copies_of_after(self: Host, node: list, events: list[Event], tall: int) -> list:
    return Host.copies(self, node, events, height(node))


def float_births(self: Host, frame: int, part: int, changed: dict, views: dict) -> None:
    for flat in changed.values():
        for node in flat[1:]:
            node[2][2] = max(-(1 << 63), min((1 << 63) - 1, int(float(node[2][2]))))
    Host.answer(self, frame, part, changed, views)


def part_zero(self: Host, frame: int, part: int, changed: dict, views: dict) -> None:
    Host.answer(self, frame, 0, changed, views)


def compare_numbers(self: Host, before: list, after: list) -> bool:
    return before != after


def ignore_gaps(self: Observer, kind: str, frame: int, number: int, *rest: Any) -> None:
    if rest[1] is None:
        number = self.sequence + 1
    Observer.on_view(self, kind, frame, number, *rest)


def no_resync(self: Observer, *message: Any) -> None:
    if message[0] != "resync":
        Role.send(self, *message)


def old_parts(self: Observer, frame: int, number: int) -> None:
    before = getattr(self, "before", {})
    self.parts = {**before, **self.parts}
    self.before = self.parts  # type: ignore[attr-defined]
    Observer.draw(self, frame, number)


def any_key(self: Observer, kind: str, frame: int, number: int, *rest: Any) -> None:
    if rest[1] is not None:
        self.sequence = -1
    Observer.on_view(self, kind, frame, number, *rest)


MUTANTS = [
    Mutant("answers a repeated tick like a new one", Generator, "P7.5 P6.13", {"on_tick": answer_again}),
    Mutant("ignores orders", Generator, "P7.1", {"ticked": without_orders}),
    Mutant("strips orders", Generator, "P3.14", {"on_orders": bare_orders}),
    Mutant("loses the sign of zero", Generator, "P5.4", {"on_orders": positive_zero}),
    Mutant("does not wait for readings", Generator, "P11.4", {"missing": no}),
    Mutant("takes readings as they arrive", Generator, "P11.6", {"distances": in_order_of_arrival}),
    Mutant("answers the tick of a dead coordinator", Generator, "P6.12", {"is_outdated": no}),
    Mutant("publishes nothing again", Generator, "P11.7", {"on_repeat": do_nothing}),
    Mutant("ignores saved data", Generator, "P8.4", {"welcome": forget_saved}),
    Mutant("has frames of 53 bits", Generator, "P3.1", {"ticked": float_frame}),
    Mutant("obeys every epoch", Generator, "P2.6 P2.7", {"follows": obey_all}),
    Mutant("obeys a later epoch at once", Generator, "P2.6", {"follows": obey_later}),
    Mutant("sends no report", Generator, "P6.23", {"on_stop": end_silently}),
    Mutant("ends well if it is refused", Generator, "P6.10", {"on_message": end_well}),
    Mutant("keeps its token", Generator, "P6.16", {"lose": keep_token}),
    Mutant("does not return", Generator, "P6.17", {"return_to_world": do_nothing}),
    Mutant("obeys a lost coordinator", Generator, "P6.16", {"lose": keep_obeying}),
    Mutant("takes any name", Generator, "P6.2", {"take_name": do_nothing}),
    Mutant("answers before its welcome", Generator, "P6.7", {"is_ready": yes}),
    Mutant("answers garbage", Generator, "P14.4", {"check": answer_garbage}),
    Mutant("subscribes to requests for hosts", Generator, "P2.4", {"subscriptions": subscribe_to_all}),
    Mutant("answers for others", Host, "P9.3", {"concerns": yes}),
    Mutant("evolves twice", Host, "P7.6", {"is_new": yes}),
    Mutant("evolves all fragments", Host, "P9.5", {"concerned": all_fragments}),
    Mutant("compares numbers", Host, "P9.18", {"differs": compare_numbers}),
    Mutant("sends all views", Host, "P9.17", {"views": all_views}),
    Mutant("keeps the views of new fragments", Host, "P9.17", {"discard": keep_views}),
    Mutant("shows other strings", Host, "P9.16", {"views": evolve_first}),
    Mutant("ignores receivers", Host, "P9.6", {"matches": to_everyone}),
    Mutant("ignores conditions", Host, "P3.10 P9.6", {"matches": unconditional}),
    Mutant("evolves newborns", Host, "P9.13", {"live": newborn_lives}),
    Mutant("emits without sender", Host, "P9.15", {"emit": without_sender}),
    Mutant("emits backwards", Host, "P9.15", {"emit": emit_backwards}),
    Mutant("draws the same in each frame", Host, "P9.24 P9.30", {"stream": same_in_each_frame}),
    Mutant("responds from the agent's stream", Host, "P9.30", {"stream": one_stream}),
    Mutant("begins its stream again", Host, "P9.27 P9.30", {"stream": begin_again}),
    Mutant("forgets the frame of a copy", Host, "P9.14", {"copy": copies_without_frame}),
    Mutant("names copies by their depth", Host, "P9.14", {"copy": copies_by_depth}),
    Mutant("measures the evolved scope", Host, "P9.14", {"copies": copies_of_after}),
    Mutant("has integers of 53 bits", Host, "P3.1", {"answer": float_births}),
    Mutant("answers part 0", Host, "P7.3", {"answer": part_zero}),
    Mutant("applies deltas after a gap", Observer, "P10.4 P10.5", {"on_view": ignore_gaps}),
    Mutant("asks for no key view", Observer, "P10.5", {"send": no_resync}),
    Mutant("keeps parts at a key view", Observer, "P10.2", {"draw": old_parts}),
    Mutant("accepts older key views", Observer, "P10.4", {"on_view": any_key}),
    Mutant("keeps its sequence", Observer, "P10.10", {"welcome": do_nothing}),
    Mutant("sends a report after it has left", Generator, "P6.21", {"leave": leave_and_stay}),
    Mutant("fails silently", Host, "P6.22", {"fail": fail_silently}),
    Mutant("answers no tick", Coupled, "P8.3", {"on_tick": do_nothing}),
]  # fmt: skip
