"""`minerva doctor --ros2 SOURCE`: what is on a robot's network, and whether a world fits it."""

from __future__ import annotations

import re
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from minerva_bus.errors import MinervaError, nearest
from minerva_services.bridges.ros2.graph import (
    LAYOUTS,
    NO_HASH,
    NODE,
    PUBLISHER,
    SERVER,
    SUBSCRIPTION,
    Announced,
)
from minerva_services.bridges.ros2.layout import ENDPOINTS, Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session, look_at
from minerva_services.bridges.ros2.qos import HEARING, LASTING
from minerva_services.bridges.ros2.uses import NetworkUser, is_of, is_of_robot, nobody
from minerva_services.bridges.ros_messages import GarbageError
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridges.ros_messages.readings import stamp_of

_OF_EACH_NODE: Final = ("rcl_interfaces/", "type_description_interfaces/")
"""Types of services that each node has, which are not listed."""

_ENDS: Final = {
    "published by ": PUBLISHER, "subscribed to by ": SUBSCRIPTION, "served by ": SERVER,
}  # fmt: skip

Found: TypeAlias = tuple[str, bool, str]
"""What was examined, whether it is good, and a note."""

_ADDRESS: Final = re.compile(r".+:\d+")
"""Host and port, which no world's name has."""

_TOPIC: Final = re.compile(r"(.+:\d+)(/.+)")
"""An endpoint, and a topic of its network."""

_LOOK_SECONDS: Final = 0.5
_LISTEN_SECONDS: Final = 2.0
_MAX_ITEMS: Final = 4
"""Number of items of an array that are shown."""


def examine(source: str) -> Iterator[Found]:
    """List a network by its endpoint, or compare the services of a world with their networks.

    An endpoint with a topic, `tcp/192.168.1.20:7447/scan`, shows what the topic carries.
    Raises MinervaError for a source that is none of these, such as an address without a protocol,
    or a world file that is wrong.
    """
    if split := _TOPIC.fullmatch(source):
        yield from _carried(Ros2Network(split[1]), split[2])
    elif source.partition("/")[0] in ENDPOINTS or _ADDRESS.fullmatch(source):
        yield from _listed(Ros2Network(source))
    else:
        # Late: a person waits for the list of a network, which needs none of this.
        from minerva_bus.launch.installed import find_world

        # The world file in this folder counts before an installed world of the same name.
        own = f"{source}.toml"
        yield from _compared(find_world(own if Path(own).is_file() else source))


def _listed(network: Ros2Network) -> Iterator[Found]:
    try:
        everything = list(look_at(network, _LOOK_SECONDS))
    except MinervaError as error:
        yield network.router, False, str(error)
        return
    if not everything:
        yield network.router, False, nobody(network)
    for layout in LAYOUTS:
        for domain in sorted({each.domain for each in everything if each.layout == layout}):
            there = [each for each in everything if (each.layout, each.domain) == (layout, domain)]
            where = f"layout {layout}" + (f", domain {domain}" if layout == "rmw_zenoh" else "")
            yield where, True, distribution(there)
            nodes = sorted({each.node for each in there if each.kind == NODE})
            if nodes:
                yield "nodes", True, ", ".join(nodes)
            yield from _topics(there)


def _carried(network: Ros2Network, topic: str) -> Iterator[Found]:
    """What a topic of a network carries, and which nodes publish it."""
    try:
        everything = list(look_at(network, _LOOK_SECONDS))
    except MinervaError as error:
        yield network.router, False, str(error)
        return
    there = [each for each in everything if each.topic == topic]
    publishers = [each for each in there if each.kind == PUBLISHER]
    yield from _topics(there)
    if not publishers:
        known = sorted({each.topic for each in everything if each.kind == PUBLISHER})
        yield topic, False, f"nobody publishes it{nearest(topic, known, 'start its node')}"
        return
    lasting = any(each.qos.lasting for each in publishers)
    yield from _received(network, publishers[0], lasting=lasting)


def _received(network: Ros2Network, publisher: Announced, *, lasting: bool) -> Iterator[Found]:
    """The rate of a publisher's topic, and the last message of a short time."""
    topic, kind = publisher.topic, publisher.message
    if kind not in messages().store.fielddefs:
        yield topic, False, f"the type {kind} is not known here, so it cannot be read"
        return
    received, times = list[tuple[float, bytes]](), list[float]()
    arrived = threading.Event()

    def receive(data: bytes) -> None:
        # Only the last message is shown, and images are large.
        received[:] = [(time.time(), data)]
        times.append(time.monotonic())
        arrived.set()

    here = replace(network, layout=publisher.layout, domain=publisher.domain)
    with closing(Ros2Session(here, "minerva_doctor")) as session:
        session.subscribe(topic, kind, receive, LASTING if lasting else HEARING)
        # The rate is that of what follows the first message.
        if arrived.wait(_LISTEN_SECONDS) and not lasting:
            time.sleep(_LISTEN_SECONDS)
    if not received:
        yield "rate", False, f"no message in {_LISTEN_SECONDS:g} s; does its node send?"
        return
    spent = times[-1] - times[0]
    yield "rate", True, f"{(len(times) - 1) / spent:.1f} Hz" if spent else "one message"
    ((at, data),) = received
    try:
        message = messages().decode(kind, data)
    except GarbageError as error:
        yield topic, False, f"no {kind}: {error}"
        return
    if hasattr(message, "header"):
        yield "age", True, f"{at - stamp_of(message):.3f} s, by the clock of this machine"
    for field in fields(message):
        if field.name != "__msgtype__":
            yield field.name, True, _text(getattr(message, field.name))


def _text(value: Any) -> str:
    """A part of a message in one line."""
    if is_dataclass(value):
        parts = [field.name for field in fields(value) if field.name != "__msgtype__"]
        return ", ".join(
            f"{name} ({text})" if is_dataclass(part) else f"{name} {text}"
            for name in parts
            for part in (getattr(value, name),)
            for text in (_text(part),)
        )
    if isinstance(value, list | tuple | np.ndarray):
        first = [_text(item) for item in value[:_MAX_ITEMS]]
        more = f" ... ({len(value):,} in all)" if len(value) > _MAX_ITEMS else ""
        return f"[{', '.join(first)}{more}]"
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    return f"{value!r:.80}" if isinstance(value, str) else str(value)


def distribution(announced: list[Announced]) -> str:
    """Which distributions of ROS 2 announce themselves so."""
    if announced[0].layout == "dds":
        return "a zenoh-bridge-ros2dds, which does not tell the distribution"
    topics = [each for each in announced if each.kind != NODE]
    humble = {each.session for each in topics if each.type_hash == NO_HASH}
    lyrical = {each.session for each in topics if each.backends} - humble
    others = {each.session for each in topics} - humble - lyrical
    known = {"Humble": humble, "Lyrical or later": lyrical, "Jazzy or later": others}
    return " and ".join(name for name, sessions in known.items() if sessions) or "only nodes"


def _topics(announced: list[Announced]) -> Iterator[Found]:
    ends = defaultdict[tuple[str, str], list[Announced]](list)
    for each in announced:
        if each.topic and not each.message.startswith(_OF_EACH_NODE):
            ends[each.topic, each.message].append(each)
    for (topic, message), there in sorted(ends.items()):
        counts = [
            f"{what}{_named(there, kind)}"
            for what, kind in _ENDS.items()
            if any(each.kind == kind for each in there)
        ]
        kinds = sorted({str(each.qos) for each in there if each.kind == PUBLISHER} - {""})
        quality = f" ({' and '.join(kinds)})" if kinds else ""
        yield topic, True, f"{message}, {', '.join(counts)}{quality}"


def _named(there: list[Announced], kind: str) -> str:
    names = sorted({each.node for each in there if each.kind == kind})
    return ", ".join(names) if any(names) else "the robot"


def _compared(path: Path) -> Iterator[Found]:
    from minerva_bus.launch.world_files import read_world_file

    services = {
        process.name: process.make_service()
        for process in read_world_file(path).processes
        if process.make_service is not None
    }
    examined = False
    for name, service in services.items():
        if isinstance(service, NetworkUser):
            examined = True
            yield from _fit(name, service)
        service.close()
    if not examined:
        remedy = "give the endpoint of a robot, tcp/HOST:7447"
        yield str(path), False, f"no process with a service of ros2; {remedy}"


def _fit(name: str, service: NetworkUser) -> Iterator[Found]:
    network = service.network
    try:
        # The world itself may run.
        everything = [each for each in look_at(network, _LOOK_SECONDS) if is_of_robot(each)]
    except MinervaError as error:
        yield name, False, str(error)
        return
    problems = list(service.problems(everything))
    for option, problem in problems:
        yield f"{name}: {option}", False, problem
    if not problems:
        here = [each for each in everything if is_of(each, network)]
        yield name, True, f"all that it needs is at {network.router}; {distribution(here)}"
