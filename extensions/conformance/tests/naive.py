"""A member written from PROTOCOL.md alone, with Zenoh and MessagePack; it declines columns.

    MINERVA_ROLE=host python naive.py

It takes part in the world of the conformance suite, as a generator, host, observer or
coupled. Each method follows one rule, so that a test can break it.
"""

import json
import math
import os
import queue
import re
import signal
import sys
import time
from collections.abc import Mapping
from hashlib import blake2b
from typing import Any

import msgpack
import zenoh

MASK = (1 << 64) - 1
GAMMA = 0x9E3779B97F4A7C15
NUMBER = (int, float)
FIELDS = {"ACounter": (NUMBER, str, int), "PBar": (NUMBER,)}
EVENTS = {
    "eAdd": (NUMBER,), "eCall": (NUMBER,), "eDraw": (), "eEnd": (), "eMaybe": (), "eName": (str,),
    "eSplit": (NUMBER,), "eShow": (),
}  # fmt: skip
ITEMS = {
    "greet": (), "refused": (str,), "sources": (dict,), "tick": ("frame",), "repeat": (str,),
    "welcome": (str, dict, int, NUMBER, "frame", str, (dict, type(None))),
    "fragments": (dict, list), "evolve": ("frame", list, list, list, "frame", list),
    "view": (str, "frame", "frame", dict, (list, type(None)), list), "orders": ("frame", list),
    "stop": (str,),
}  # fmt: skip
KIND = [
    "ACounter", [["total", "real m", "0"], ["name", "text", '""'], ["births", "int", "0"]],
    ["eAdd", "eCall", "eDraw", "eEnd", ["eMaybe", 0.5], "eName", "eSplit"], ["eShow"], [],
]  # fmt: skip


class Invalid(Exception):
    """A message that cannot be read."""


class Ended(Exception):
    """The member ends with this exit code."""


# --- random streams (section 9) ---


def mix(z: int) -> int:
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def hash_of(agent: str) -> int:
    h = 0
    for byte in agent.encode():
        h = (h * GAMMA + byte) & MASK
    return h


def keyed(*parts: object) -> int:
    text = "\0".join(map(str, parts)).encode()
    return int.from_bytes(blake2b(text, digest_size=8).digest(), "little")


class Stream:
    """SplitMix64."""

    def __init__(self, word: int) -> None:
        self.word = word

    def draw(self) -> float:
        self.word = (self.word + GAMMA) & MASK
        return (mix(self.word) >> 11) * 2.0**-53


# --- conditions (section 3) ---

TOKEN = re.compile(
    r'\s*("(?:[^"\\]|\\.)*"|<=|>=|==|!=|[<>()]|-?[0-9.]+(?:e[-+]?\d+)?|[A-Za-z_]\w*)'
)


def holds(text: str, state: Mapping[str, Any]) -> bool:
    tokens = TOKEN.findall(text)

    def value() -> Any:
        token = tokens.pop(0)
        if token[0] in '"-.0123456789':
            return json.loads(token)
        return {"true": True, "false": False}.get(token, state.get(token))

    def term() -> bool:
        if tokens[0] == "not":
            tokens.pop(0)
            return not term()
        if tokens[0] == "(":
            tokens.pop(0)
            result = either()
            tokens.pop(0)
            return result
        left, operator, right = value(), tokens.pop(0), value()
        return {
            "<": lambda: left < right, "<=": lambda: left <= right, ">": lambda: left > right,
            ">=": lambda: left >= right, "==": lambda: left == right, "!=": lambda: left != right,
        }[operator]()  # fmt: skip

    def both() -> bool:
        result = term()
        while tokens[:1] == ["and"]:
            tokens.pop(0)
            result = term() and result
        return result

    def either() -> bool:
        result = both()
        while tokens[:1] == ["or"]:
            tokens.pop(0)
            result = both() or result
        return result

    return not tokens or either()


# --- strings (section 3): [symbol, id, values, scope] for agents, [symbol, values] for figures ---


def is_value(value: Any, kind: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, kind):
        return False
    return isinstance(value, str) or math.isfinite(value)


def values_of(symbol: Any, values: Any) -> list:
    kinds = FIELDS.get(symbol)
    if kinds is None or not isinstance(values, list) or len(values) != len(kinds):
        raise Invalid(f"{symbol} {values}")
    if not all(map(is_value, values, kinds)):
        raise Invalid(f"the values of {symbol}")
    return [float(v) if kind is NUMBER else v for v, kind in zip(values, kinds, strict=True)]


def tree(flat: Any) -> list:
    """The nodes of a flat string."""
    if not isinstance(flat, list) or not flat or not isinstance(flat[0], int):
        raise Invalid("a string")
    rest = flat[1:]

    def scope(count: int) -> list:
        return [node() for _ in range(count)]

    def node() -> list:
        if not rest:
            raise Invalid("a string is cut off")
        match rest.pop(0):
            case [str(symbol), str(agent), None, 0]:
                return [symbol, agent, None, []]
            case [str(symbol), str(agent), values, int(count)]:
                return [symbol, agent, values_of(symbol, values), scope(count)]
            case [str(symbol), values]:
                return [symbol, values_of(symbol, values)]
            case _:
                raise Invalid("a node")

    nodes = scope(flat[0])
    if rest:
        raise Invalid("a string has data after its end")
    return nodes


def flat(nodes: list) -> list:
    result: list = [len(nodes)]

    def add(node: list) -> None:
        symbol, agent, values, scope = node
        result.append([symbol, agent, values, len(scope)])
        for inner in scope:
            add(inner)

    for node in nodes:
        add(node)
    return result


def height(node: list) -> int:
    return 1 + max(map(height, node[3]), default=0)


def derived(agent: str, mark: str, before: str) -> str:
    name = f"{agent}:{mark}"
    if len(name) <= 64:
        return name
    digest = blake2b(name.encode(), digest_size=12).hexdigest()
    return f"{agent[:16].split(':')[0]}:{before}-{digest}"


class Event:
    """An event: [type, values] or [type, values, condition, sender, receivers]."""

    def __init__(self, plain: Any) -> None:
        if not isinstance(plain, list) or len(plain) not in (2, 5) or plain[0] not in EVENTS:
            raise Invalid("an event")
        self.type, values, *rest = plain
        if len(values) != len(EVENTS[self.type]) or not all(
            map(is_value, values, EVENTS[self.type])
        ):
            raise Invalid(f"the data of {self.type}")
        kinds = EVENTS[self.type]
        self.values = [float(v) if k is NUMBER else v for v, k in zip(values, kinds, strict=True)]
        self.condition, self.sender, self.receivers = rest or ("", "", [])

    def plain(self) -> list:
        short = [self.type, self.values]
        long = [self.condition, self.sender, self.receivers]
        return [*short, *long] if any(long) else short


# --- roles ---


class Role:
    """What a member does after its welcome; `send` sends a message to the coordinator."""

    subscribes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()

    def __init__(self, member: "NaiveMember") -> None:
        self.member = member

    def hello(self) -> dict:
        return {}

    def welcome(self, welcome: dict, again: bool) -> None:
        """The member has joined, or has joined the same run again."""

    def report(self) -> dict:
        return {}

    def send(self, *message: Any) -> None:
        self.member.send(*message)


class Generator(Role):
    """A generator in step with orders, readings and a topic."""

    subscribes = ("tick",)
    publishes = ("echo",)
    topics = ("sight",)

    def __init__(self, member: "NaiveMember") -> None:
        super().__init__(member)
        self.count = 0
        self.asked: int | None = None
        self.asked_by = -1  # The epoch of the coordinator; its successor asks again.
        self.answers: dict[int, tuple] = {}
        self.orders: dict[int, list] = {}
        self.sources: list[str] = []
        self.readings: dict[tuple[int, str], list] = {}

    def hello(self) -> dict:
        return {
            "generates": ["eAdd"], "when": "in step", "orders": ["eAdd"],
            "topics": list(self.topics), "publishes": list(self.publishes),
        }  # fmt: skip

    def welcome(self, welcome: dict, again: bool) -> None:
        self.asked, self.readings = None, {}
        if again and welcome["frame"] in self.answers:
            return
        self.answers = {}
        if welcome["saved"] is not None:
            self.count = welcome["saved"]["count"]

    def report(self) -> dict:
        return {"ticks": self.count}

    def on_sources(self, publishers: dict) -> None:
        self.sources = publishers.get("sight", [])
        self.try_to_answer()

    def on_orders(self, frame: int, events: list) -> None:
        self.orders[frame] = [Event(event).plain() for event in events]

    def on_readings(self, publisher: str, frame: int, readings: list) -> None:
        if not all(isinstance(r, list) and r[0] == "sightings" for r in readings):
            raise Invalid("readings")
        self.readings[frame, publisher] = [seen[1] for r in readings for seen in r[3]]
        self.try_to_answer()

    def on_tick(self, frame: int) -> None:
        if frame in self.answers:
            self.give(self.answers[frame])
            return
        self.asked, self.asked_by = frame, self.member.epoch
        self.try_to_answer()

    def is_outdated(self) -> bool:
        return self.asked_by != self.member.epoch

    def missing(self, frame: int) -> bool:
        return any((frame, publisher) not in self.readings for publisher in self.sources)

    def try_to_answer(self) -> None:
        if self.asked is None or self.is_outdated() or self.missing(self.asked):
            return
        frame, self.asked = self.asked, None
        answer = self.published(frame), self.ticked(frame)
        self.answers = {n: a for n, a in self.answers.items() if n >= frame - 1} | {frame: answer}
        self.give(answer)

    def ticked(self, frame: int) -> tuple:
        due = [n for n in sorted(self.orders) if n <= frame]
        orders = [event for n in due for event in self.orders.pop(n)]
        events = [["eAdd", [self.count + 0.5]], *orders]
        events += [["eAdd", [distance]] for distance in self.distances(frame)]
        self.count += 1
        return ("ticked", frame, events, self.saved())

    def distances(self, frame: int) -> list:
        keys = [key for key in self.readings if key[0] in (frame, -1)]
        publishers = sorted(keys, key=lambda key: key[1])
        return [distance for key in publishers for distance in self.readings.pop(key)]

    def saved(self) -> dict | None:
        return {"count": self.count}

    def published(self, frame: int) -> tuple:
        return ("readings", frame, [["battery", "r1", float(frame), 1.0, float(self.count)]])

    def give(self, answer: tuple) -> None:
        published, ticked = answer
        self.member.publish("echo", published)
        self.send(*ticked)

    def on_repeat(self, topic: str) -> None:
        if topic == "echo" and self.answers:
            self.member.publish("echo", self.answers[max(self.answers)][0])


class Observer(Role):
    """A device that draws the views of eShow."""

    subscribes = ("view/eShow",)

    def __init__(self, member: "NaiveMember") -> None:
        super().__init__(member)
        self.sequence = -1
        self.skeleton: list | None = None
        self.parts: dict[str, list] = {}
        self.drawn: dict[str, Any] = {}

    def hello(self) -> dict:
        return {"draws": ["eShow"], "when": "each frame"}

    def welcome(self, welcome: dict, again: bool) -> None:
        self.sequence = -1

    def on_view(
        self, kind: str, frame: int, number: int, parts: dict, skeleton: Any, _: list
    ) -> None:
        new = {agent: tree(part) for agent, part in parts.items()}
        if skeleton is not None:
            nodes = tree(skeleton)
            if number >= self.sequence:
                self.skeleton, self.parts = nodes, new
                self.draw(frame, number)
        elif self.skeleton is None or number > self.sequence + 1:
            self.send("resync", kind)
        elif number == self.sequence + 1:
            self.parts |= new
            self.draw(frame, number)

    def draw(self, frame: int, number: int) -> None:
        self.sequence = number
        bars: list = []
        for node in self.skeleton or []:
            bars += [node] if node[0] == "PBar" else self.parts.get(node[1], [])
        self.drawn = {"bars": len(bars), "length": sum(bar[1][0] for bar in bars), "frame": frame}

    def report(self) -> dict:
        return self.drawn


class Coupled(Observer):
    """A coupled device, which answers ticks."""

    subscribes = ("tick",)

    def __init__(self, member: "NaiveMember") -> None:
        super().__init__(member)
        self.views = 0

    def hello(self) -> dict:
        return {"draws": ["eShow"], "when": "each frame", "coupled": True}

    def draw(self, frame: int, number: int) -> None:
        super().draw(frame, number)
        self.views += 1

    def on_tick(self, frame: int) -> None:
        self.send("ticked", frame, [], None)

    def report(self) -> dict:
        return {**self.drawn, "views": self.views}


class Host(Role):
    """A host of ACounter."""

    subscribes = ("evolve",)

    def __init__(self, member: "NaiveMember") -> None:
        super().__init__(member)
        self.fragments: dict[str, list] = {}
        self.shown: dict[str, list] = {}
        self.evolved: set[tuple[int, int]] = set()
        self.frame = -1
        self.literal = False
        self.emitted: dict[str, list] = {}
        self.streams: dict[tuple, Stream] = {}

    def hello(self) -> dict:
        return {"kinds": [KIND]}

    def welcome(self, welcome: dict, again: bool) -> None:
        self.fragments, self.shown, self.evolved = {}, {}, set()
        if welcome["policy"] not in ("sequential", "literal"):
            raise ValueError(f"the world's policy is {welcome['policy']!r}")
        self.literal = welcome["policy"] == "literal"

    def on_fragments(self, given: dict, dropped: list) -> None:
        new = {name: tree(string) for name, string in given.items()}
        for name in (*dropped, *new):
            self.discard(name)
        self.fragments |= new

    def discard(self, name: str) -> None:
        self.fragments.pop(name, None)
        self.shown.pop(name, None)

    def on_evolve(
        self, frame: int, asked: list, events: list, visual: list, part: int, only: list
    ) -> None:
        if not self.concerns(asked):
            return
        read = [Event(event) for event in events]
        names = self.concerned(only)
        if any(name not in self.fragments for name in names):
            raise Invalid("a fragment that was not given")
        if not self.is_new(frame, part):
            return
        self.frame, self.emitted, self.streams = frame, {}, {}
        views = self.views(names) if visual else {}
        changed = {}
        for name in names:
            before = self.fragments[name]
            after = self.evolve_all(before, read) if read or self.literal else before
            if self.differs(before, after):
                changed[name] = flat(after)
            self.keep(name, after)
        self.answer(frame, part, changed, {"eShow": views} if visual else {})

    def answer(self, frame: int, part: int, changed: dict, views: dict) -> None:
        self.send("evolved", frame, part, changed, self.emitted, views)

    def concerns(self, asked: list) -> bool:
        return self.member.name in asked

    def concerned(self, only: list) -> list:
        return only or list(self.fragments)

    def is_new(self, frame: int, part: int) -> bool:
        new = (frame, part) not in self.evolved
        self.evolved = {(n, p) for n, p in self.evolved if n == frame} | {(frame, part)}
        return new

    def differs(self, before: list, after: list) -> bool:
        # Compared as bytes, because 0.0 equals -0.0.
        return msgpack.packb(before) != msgpack.packb(after)

    def keep(self, name: str, after: list) -> None:
        if name.startswith("~") or (len(after) == 1 and after[0][1] == name):
            self.fragments[name] = after
        else:
            self.discard(name)

    def views(self, names: list) -> dict:
        views = {name: [self.view(self.fragments[name])] for name in names}
        new = {name: view for name, (view,) in views.items() if self.shown.get(name) != view}
        self.shown |= new
        return new

    def view(self, nodes: list) -> list:
        return [len(nodes), *(["PBar", [values[0]]] for _, _, values, _ in nodes)]

    def evolve_all(self, nodes: list, events: list[Event]) -> list:
        return [new for node in nodes for new in self.evolve(node, events)]

    def evolve(self, node: list, events: list[Event]) -> list:
        symbol, agent, values, scope = node
        inside = self.evolve_all(scope, events)
        if self.literal:
            return self.copies([symbol, agent, values, inside], events, height(node))
        return self.live([symbol, agent, list(values), inside], events, agent)

    def copies(self, node: list, events: list[Event], tall: int) -> list:
        result = []
        for number, event in enumerate(events, 1):
            copy = self.copy(node, number, tall) if number > 1 else node
            result += self.live([*copy[:2], list(copy[2]), copy[3]], [event], node[1])
        return result

    def copy(self, node: list, number: int, tall: int, inner: bool = False) -> list:
        symbol, agent, values, scope = node
        mark = f"{self.frame}-{number}" + (f"-{tall}" if inner else "")
        inside = [self.copy(each, number, tall, inner=True) for each in scope]
        return [symbol, derived(agent, mark, f"{self.frame}"), values, inside]

    def live(self, node: list, events: list[Event], receiver: str) -> list:
        """An agent after the events that concern it, and its children."""
        newborn: list = []
        for event in events:
            if not self.matches(event, node, receiver):
                continue
            result = self.act(event, node, receiver)
            if result is None:
                return newborn
            self.check(node[2])
            newborn = [*result, *newborn]
        return [node, *newborn]

    def check(self, values: list) -> None:
        total, _, births = values
        if not math.isfinite(total) or births >= 1 << 63:
            raise ArithmeticError(f"{total} or {births} is no value")

    def matches(self, event: Event, node: list, receiver: str) -> bool:
        if event.receivers and receiver not in event.receivers:
            return False
        total, name, births = node[2]
        state = {"total": total, "name": name, "births": births}
        if event.condition and not holds(event.condition, state):
            return False
        return event.type != "eMaybe" or self.stream(node[1], "eMaybe").draw() < 0.5

    def stream(self, agent: str, *purpose: str) -> Stream:
        key = (agent, *purpose)
        if key not in self.streams:
            word = keyed(self.member.seed, self.frame, *purpose) ^ hash_of(agent)
            self.streams[key] = Stream(mix(word))
        return self.streams[key]

    def act(self, event: Event, node: list, receiver: str) -> list | None:
        """λ: changes the node and returns its children; None if it dies."""
        values = node[2]
        match event.type, event.values:
            case "eAdd", [amount]:
                values[0] += amount
            case "eCall", [amount]:
                self.emit(receiver, ["eAdd", [amount], "", node[1], []])
                self.emit(receiver, ["eAdd", [amount / 2.0], "", node[1], [node[1]]])
            case "eDraw", _:
                values[0] = self.stream(node[1]).draw()
            case "eEnd", _:
                return None
            case "eMaybe", _:
                values[0] += 1.0
            case "eName", [name]:
                values[1] = name
            case "eSplit", [amount]:
                values[2] += 1
                return [["ACounter", derived(node[1], str(values[2]), ""), [amount, "", 0], []]]
        return []

    def emit(self, agent: str, event: list) -> None:
        self.emitted.setdefault(agent, []).append(event)


ROLES = {
    "generator": Generator,
    "host": Host,
    "observer": Observer,
    "coupled": Coupled,
}


# --- the member (sections 1, 2 and 6) ---


class NaiveMember:
    """A member in one role."""

    role_classes = ROLES

    def __init__(self, environment: Mapping[str, str]) -> None:
        self.world, self.name = environment["MINERVA_WORLD"], environment["MINERVA_NAME"]
        self.endpoint = environment["MINERVA_CONNECT"]
        self.role = self.role_classes[environment.get("MINERVA_ROLE", "generator")](self)
        self.inbox: queue.SimpleQueue = queue.SimpleQueue()
        self.epoch, self.obeys = -1, False
        self.joined: dict | None = None
        self.seed = 0
        self.token: Any = None
        self.there = False
        self.until: float | None = None

    def key(self, rest: str) -> str:
        return f"minerva/{self.world}/{rest}"

    def hello(self) -> dict:
        return {
            "version": 7, "kinds": [], "generates": [], "when": "", "orders": [], "draws": [],
            "coupled": False, "topics": [], "publishes": [], "plain": True,
            "about": {"service": "naive", "pid": os.getpid()}, **self.role.hello(),
        }  # fmt: skip

    def run(self) -> int:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/timeout_ms", "5000")
        config.insert_json5("connect/exit_on_failure", "true")
        with zenoh.open(config) as session:
            self.session = session
            try:
                self.take_name()
                declared = self.declare()
                try:
                    self.take_part()
                finally:
                    self.release()
                    for declaration in declared:
                        declaration.undeclare()
            except Ended as end:
                return end.args[0]
        return 0

    def is_taken(self) -> bool:
        alive = self.key(f"alive/{self.name}")
        return bool(list(self.session.liveliness().get(alive, timeout=1.0)))

    def take_name(self) -> None:
        until = time.monotonic() + 2.0
        while self.is_taken():
            if time.monotonic() > until:
                raise Ended(1)
            time.sleep(0.05)

    def callback(self) -> Any:
        return zenoh.handlers.Callback(self.inbox.put, indirect=False)

    def subscriptions(self) -> list[str]:
        topics = [f"topic/{topic}/*" for topic in self.role.topics]
        return ["all", f"to/{self.name}", *self.role.subscribes, *topics]

    def declare(self) -> list:
        session, block = self.session, zenoh.CongestionControl.BLOCK
        declared: list = [
            session.declare_subscriber(self.key(rest), self.callback())
            for rest in self.subscriptions()
        ]
        keys = {topic: f"topic/{topic}/{self.name}" for topic in self.role.publishes}
        keys[""] = f"from/{self.name}"
        self.publishers = {
            topic: session.declare_publisher(self.key(rest), congestion_control=block)
            for topic, rest in keys.items()
        }
        alive = self.key("alive/coordinator")
        liveliness = session.liveliness()
        declared += self.publishers.values()
        declared.append(liveliness.declare_subscriber(alive, self.callback(), history=True))
        self.declare_token()
        return declared

    def declare_token(self) -> None:
        self.token = self.session.liveliness().declare_token(self.key(f"alive/{self.name}"))

    def release(self) -> None:
        if self.token is not None:
            self.token.undeclare()
            self.token = None

    def stop(self) -> None:
        """End the member; from another thread."""
        self.inbox.put(None)

    def leave(self) -> None:
        if self.joined is not None:
            self.send("leaving")

    def take_part(self) -> None:
        self.until = time.monotonic() + 10.0
        while True:
            wait = None if self.until is None else max(0.0, self.until - time.monotonic())
            try:
                sample = self.inbox.get(timeout=wait)
            except queue.Empty:
                raise Ended(1) from None
            if sample is None:
                self.leave()
                raise Ended(0)
            self.on_sample(str(sample.key_expr), sample)

    def on_sample(self, key: str, sample: Any) -> None:
        if key == self.key("alive/coordinator"):
            self.on_coordinator(sample.kind != zenoh.SampleKind.DELETE)
            return
        data = sample.payload.to_bytes()
        try:
            if key.startswith(self.key("topic/")):
                self.on_topic(key, data)
            else:
                self.on_bytes(data)
        except Invalid as problem:
            print(f"dropped: {problem}", file=sys.stderr)
        except ArithmeticError as problem:
            self.fail(problem)

    def fail(self, problem: Exception) -> None:
        self.send("failed", -1, str(problem), "")
        raise Ended(1)

    def on_coordinator(self, there: bool) -> None:
        if there and not self.there and self.token is None:
            self.return_to_world()
        elif not there and self.there:
            self.lose()
        self.there = there

    def lose(self) -> None:
        self.release()
        self.epoch, self.obeys = self.epoch - 1, False
        self.until = time.monotonic() + 5.0

    def return_to_world(self) -> None:
        until = time.monotonic() + 4.0
        while self.is_taken():
            if time.monotonic() > until:
                raise Ended(1)
            time.sleep(0.05)
        self.until = time.monotonic() + 10.0
        self.declare_token()

    def on_topic(self, key: str, data: bytes) -> None:
        if self.joined is None:
            return
        match self.unpacked(data):
            case ["readings", int(frame), list(readings)] if frame >= -1:
                self.role.on_readings(key.rpartition("/")[2], frame, readings)  # type: ignore[attr-defined]
            case _:
                raise Invalid("readings")

    def unpacked(self, data: bytes) -> Any:
        try:
            return msgpack.unpackb(data, strict_map_key=True)
        except Exception as problem:
            raise Invalid(problem) from None

    def on_bytes(self, data: bytes) -> None:
        unpacker = msgpack.Unpacker()
        unpacker.feed(data)
        try:
            epoch = unpacker.unpack()
        except Exception as problem:
            raise Invalid(problem) from None
        message = self.unpacked(data[unpacker.tell() :])
        if not isinstance(epoch, int) or not isinstance(message, list) or not message:
            raise Invalid("a message")
        self.check(message)
        if self.follows(epoch, message[0]):
            self.on_message(*message)

    def check(self, message: list) -> None:
        name, *items = message
        kinds = ITEMS.get(name) if isinstance(name, str) else None
        if kinds is None or len(kinds) != len(items):
            raise Invalid(name)
        for item, kind in zip(items, kinds, strict=True):
            expected = int if kind == "frame" else kind
            if isinstance(item, bool) or not isinstance(item, expected):
                raise Invalid(name)
            if kind == "frame" and item < 0:
                raise Invalid(name)

    def follows(self, epoch: int, name: str) -> bool:
        """Whether a message is of the coordinator that the member obeys."""
        if epoch > self.epoch and name in ("greet", "refused", "stop"):
            self.epoch, self.obeys = epoch, True
        return self.obeys and epoch == self.epoch

    def on_message(self, name: str, *items: Any) -> None:
        if name == "greet":
            self.send("hello", self.hello())
        elif name == "welcome":
            self.on_welcome(*items)
        elif name == "refused":
            raise Ended(2)
        elif name == "stop":
            self.on_stop()
        elif self.is_ready(name):
            handler = getattr(self.role, f"on_{name}", None)
            if handler is not None:
                handler(*items)

    def is_ready(self, name: str) -> bool:
        return self.joined is not None or name == "sources"

    def on_welcome(
        self,
        world: str,
        vocabulary: dict,
        seed: int,
        dt: float,
        frame: int,
        policy: str,
        saved: Any,
    ) -> None:
        again = self.joined is not None
        if self.joined is not None and (seed, dt) != (self.joined["seed"], self.joined["dt"]):
            raise Ended(1)
        self.joined = {"seed": seed, "dt": dt, "frame": frame, "policy": policy, "saved": saved}
        self.seed, self.until = seed, None
        self.role.welcome(self.joined, again)

    def on_stop(self) -> None:
        self.send("report", self.role.report())
        # The report must arrive before the session ends.
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            try:
                sample = self.inbox.get(timeout=until - time.monotonic())
            except queue.Empty:
                break
            if sample is None or sample.kind == zenoh.SampleKind.DELETE:
                break
        raise Ended(0)

    def send(self, *message: Any) -> None:
        self.put("", msgpack.packb(self.epoch) + msgpack.packb(message))

    def publish(self, topic: str, readings: tuple) -> None:
        self.put(topic, msgpack.packb(readings))

    def put(self, topic: str, data: bytes) -> None:
        self.publishers[topic].put(data)


if __name__ == "__main__":
    member = NaiveMember(os.environ)
    signal.signal(signal.SIGTERM, lambda *_: member.stop())
    sys.exit(member.run())
