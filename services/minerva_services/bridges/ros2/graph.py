"""The nodes and topics of a robot, as they announce themselves, and what of a service fits them.

Nodes of rmw_zenoh have liveliness tokens `@ros2_lv/DOMAIN/SESSION/...`, a zenoh-bridge-ros2dds has
`@/SESSION/@ros2_lv/...` for the topics of its robot.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from minerva_services.bridges.ros2.qos import DEFAULT, Qos, announced_qos

LAYOUTS: Final = ("rmw_zenoh", "dds")
NODE, PUBLISHER, SUBSCRIPTION, SERVER = "NN", "MP", "MS", "SS"
_KINDS: Final = (NODE, PUBLISHER, SUBSCRIPTION, SERVER)
_ACTION_SERVER: Final = "AS"
"""Kind of a bridge for DDS for the three services and two topics of an action."""

SEND_GOAL: Final = "_action/send_goal"
"""Where an action accepts goals, after its name; the type of this service has a suffix, too."""

NO_HASH: Final = "TypeHashNotSupported"
"""What ROS 2 Humble announces in place of the hash of a type."""

TOKENS: Final = ("@ros2_lv/**", "@/*/@ros2_lv/**")
"""Key expressions of all tokens: of rmw_zenoh, and of bridges for DDS."""

_BACKENDS: Final = "backends:"
CPU: Final = "cpu"
"""The kind of memory whose messages contain their bytes."""


@dataclass(frozen=True, slots=True)
class Announced:
    """A node, or one of its publishers, subscriptions and services.

    `layout` is that of its network; `session` is the Zenoh session that it belongs to. A bridge for
    DDS announces no nodes and no hashes, and its `domain` is 0. `backends` are the kinds of memory
    that it shares, as nodes do from Lyrical on.
    """

    layout: str
    domain: int
    session: str
    kind: str
    node: str
    topic: str = ""
    message: str = ""
    type_hash: str = ""
    qos: Qos = DEFAULT
    backends: tuple[str, ...] = ()


def announced(token: str) -> Announced | None:
    """What a token announces; None for other parts of the graph, such as clients of services.

    An action is announced by its service for goals.
    """
    parts = token.split("/")
    try:
        if parts[0] == "@ros2_lv":
            return _of_rmw_zenoh(*parts[1:])
        _, session, _, kind, topic, message, *qos = parts
    except (TypeError, ValueError):
        return None
    # Such a bridge writes slashes as §, and types as people do.
    name, kind_of_message = f"/{topic.replace('§', '/')}", message.replace("§", "/")
    if kind == _ACTION_SERVER:
        name, kind_of_message = f"{name}/{SEND_GOAL}", f"{kind_of_message}_SendGoal"
    elif kind not in _KINDS:
        return None
    kind = SERVER if kind == _ACTION_SERVER else kind
    about = announced_qos("".join(qos), "dds")
    return Announced("dds", 0, session, kind, "", name, kind_of_message, qos=about)


def _of_rmw_zenoh(
    domain: str, session: str, _: str, __: str, kind: str, ___: str, namespace: str, node: str,
    topic: str = "", message: str = "", type_hash: str = "", qos: str = "", backends: str = "",
) -> Announced | None:  # fmt: skip
    if kind not in _KINDS:
        return None
    name = f"{_demangled(namespace).rstrip('/')}/{node}"
    return Announced(
        "rmw_zenoh", int(domain), session, kind, name,
        _demangled(topic), ros_type(message), type_hash,
        announced_qos(qos, "rmw_zenoh"), _kinds_of_memory(backends),
    )  # fmt: skip


def _kinds_of_memory(backends: str) -> tuple[str, ...]:
    kinds = backends.removeprefix(_BACKENDS).split(";") if backends.startswith(_BACKENDS) else ()
    return tuple(kind.partition(":")[0] for kind in kinds)


def mangled(name: str) -> str:
    """A name as part of a token of rmw_zenoh."""
    return name.replace("/", "%")


def _demangled(part: str) -> str:
    return part.replace("%", "/")


def dds_type(message: str) -> str:
    """A message type's DDS name: `sensor_msgs::msg::dds_::LaserScan_`."""
    package, kind, name = message.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(name: str) -> str:
    """Inverse of `dds_type`."""
    return name.replace("::dds_::", "::").replace("::", "/").removesuffix("_")


class RosGraph:
    """What is announced on a network at present; thread-safe.

    What this program's own `session` announces is left out.
    """

    def __init__(self, session: str = "") -> None:
        self._own = session
        self._announced: dict[str, Announced] = {}
        self._lock = threading.Lock()

    def update(self, token: str, *, is_there: bool) -> None:
        """Add or remove a token; unknown ones are ignored."""
        about = announced(token)
        if about is None or about.session == self._own:
            return
        with self._lock:
            if is_there:
                # The first object stays: another one means that its owner has been away.
                self._announced.setdefault(token, about)
            else:
                self._announced.pop(token, None)

    def __iter__(self) -> Iterator[Announced]:
        with self._lock:
            return iter(list(self._announced.values()))

    def numbers(self, topic: str, message: str) -> int:
        """How many numbers a publisher gives a message, of which this program receives one.

        One that shares memory sends the message once for all who take its bytes, and once more to
        each who shares other memory; but only once if a subscription shares none.
        """
        others = [each.backends for each in self._subscriptions(topic, message)]
        return 1 if () in others else 1 + sum(each != (CPU,) for each in others)

    def hashes(self, topic: str, message: str) -> set[str]:
        """The hashes that subscriptions to a topic expect."""
        return {each.type_hash for each in self._subscriptions(topic, message)}

    def _subscriptions(self, topic: str, message: str) -> Iterator[Announced]:
        wanted = SUBSCRIPTION, topic, message
        return (each for each in self if (each.kind, each.topic, each.message) == wanted)
