"""`minerva doctor --ros2 SOURCE`: what is on a robot's network, and whether a world fits it."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Final, TypeAlias

from minerva_bus.errors import MinervaError
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
from minerva_services.bridges.ros2.network import look_at
from minerva_services.bridges.ros2.uses import NetworkUser, is_of, is_of_robot, nobody

_OF_EACH_NODE: Final = ("rcl_interfaces/", "type_description_interfaces/")
"""Types of services that each node has, which are not listed."""

_ENDS: Final = {
    "published by ": PUBLISHER, "subscribed to by ": SUBSCRIPTION, "served by ": SERVER,
}  # fmt: skip

Found: TypeAlias = tuple[str, bool, str]
"""What was examined, whether it is good, and a note."""

_ADDRESS: Final = re.compile(r".+:\d+")
"""Host and port, which no world's name has."""

_LOOK_SECONDS: Final = 0.5


def examine(source: str) -> Iterator[Found]:
    """List a network by its endpoint, or compare the services of a world with their networks.

    Raises MinervaError for a source that is neither, such as an address without a protocol, or a
    world file that is wrong.
    """
    if source.partition("/")[0] in ENDPOINTS or _ADDRESS.fullmatch(source):
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
