"""What a service expects of a robot's topics, and how the robot differs from it, with remedies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_services.bridges.ros2.graph import (
    LAYOUTS,
    PUBLISHER,
    SERVER,
    SUBSCRIPTION,
    Announced,
)
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.qos import HEARING, LASTING, Qos, asked_qos
from minerva_services.bridges.ros_messages.messages import (
    DETECTIONS,
    TRANSFORMS,
    TWIST,
    TWIST_STAMPED,
)

_MAX_NAMED: Final = 5
_STARTS: Final = {
    "rmw_zenoh": "start its nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp, and connect them to it",
    "dds": "start a zenoh-bridge-ros2dds beside it that listens there",
}
_OWN_NODES: Final = "minerva_"


@dataclass(frozen=True, slots=True)
class TopicUse:
    """A topic of a service; `option` is its name in a world file.

    `sends`: the service publishes on it, `exclusive`: and no other node may; `needed`: somebody
    must be at the other end. `suffix` follows the option's value in the topic's name, and `instead`
    is what to do without such a topic, by default to empty the option. `others` are the options for
    other types of messages.
    """

    option: str
    topic: str
    message: str
    sends: bool = False
    exclusive: bool = False
    qos: Qos = HEARING
    needed: bool = True
    suffix: str = ""
    instead: str = ""
    others: Mapping[str, str] = field(default_factory=dict[str, str])

    @property
    def name(self) -> str:
        """Its name in the table `qos`."""
        return f"{self.option}{self.suffix}"

    def set_to(self, topic: str) -> str:
        """What to write into a world file for a topic."""
        if self.option.startswith(WATCH):
            return f'name "{topic}" in watch' if topic else "remove it from watch"
        if self.option.startswith(EVENTS):
            return f'name the table {EVENTS}"{topic}"' if topic else f"remove {self.option}"
        return f'set {self.option} = "{topic.removesuffix(self.suffix)}"'


EVENTS: Final = "events."
"""Begin of the options of topics that have tables of their own."""

WATCH: Final = "watch."
"""Begin of the options of topics that are only watched."""


def topic_uses(
    network: Ros2Network, uses: Iterable[TopicUse], given: Mapping[str, Any] | None
) -> tuple[TopicUse, ...]:
    """The topics that are not empty, with the quality of service that is `given` by option.

    Raises MisuseError, also for names that are none: not in the thread that connects.
    """
    if not isinstance(given, Mapping | None):
        raise MisuseError(f'ros2: qos is {given!r:.60}; expected a table, {{scan = "sensor_data"}}')
    table, changed = dict(given or {}), list[TopicUse]()
    for use in uses:
        if not use.topic and not use.option.startswith(EVENTS):
            continue
        network.name(use.topic)
        qos = asked_qos(f"qos.{use.name}", table.pop(use.name, None), use.qos)
        changed.append(replace(use, qos=qos))
    for name in table:
        names = [use.name for use in changed if not use.option.startswith(EVENTS)]
        near = nearest(name, names, f"it may have {', '.join(names)}")
        raise MisuseError(f"ros2: qos has {name!r}, which is no topic that is used{near}")
    return tuple(changed)


def transforms_uses(network: Ros2Network, *, needed: bool) -> tuple[TopicUse, TopicUse]:
    """The transforms that place sensors: those that never change, and others."""
    given = 'set mount = "x, y, degrees"'
    static = TopicUse(
        "tf", network.static_tf, TRANSFORMS,
        qos=LASTING, needed=needed, suffix="_static", instead=given,
    )  # fmt: skip
    return static, TopicUse("tf", network.tf, TRANSFORMS, needed=False)


def mismatches(
    graph: Iterable[Announced], network: Ros2Network, uses: Sequence[TopicUse],
    heard: Collection[str] = (),
) -> Iterator[tuple[str, str]]:  # fmt: skip
    """By option, what does not fit between a service and a network, and what to do.

    Of topics whose types of messages are `heard`, only that several nodes publish them.
    """
    silent = [use for use in uses if use.message not in heard]
    wrong = dict(misfits(network, silent))
    yield from wrong.items()
    everything = list(graph)
    # For a view, nobody has to be there: RViz may come later.
    may_be_empty = not any(use.needed for use in uses)
    if not uses or (may_be_empty and not any(map(is_of_robot, everything))):
        return
    here = [each for each in everything if is_of(each, network)]
    if silent and not any(map(is_of_robot, here)):
        yield _elsewhere(everything, network)
        return
    namespace = _namespace(here, network, silent)
    for use in [use for use in uses if use.option not in wrong]:
        problem = _several(here, network, use)
        if not problem and use in silent:
            problem = _problem(here, network, use, namespace)
        if problem:
            yield use.option, problem


def misfits(network: Ros2Network, uses: Sequence[TopicUse]) -> Iterator[tuple[str, str]]:
    """By option, what fits no robot, and what to do."""
    if network.layout == "dds" and network.domain:
        yield (
            "domain",
            f'domain = {network.domain} has no effect with layout = "dds": the bridge has its'
            " own; remove it",
        )
    namespace = network.namespace.strip("/")
    taken: dict[str, TopicUse] = {}
    for use in uses:
        name = f"/{network.name(use.topic)}"
        twice = f"/{namespace}/{namespace}/"
        if namespace and name.startswith(twice):
            remedy = use.set_to(name.removeprefix(twice))
            yield use.option, f"{name} has the namespace twice; {remedy}"
        first = taken.setdefault(name, use)
        if first.message != use.message:
            yield (
                use.option,
                f"{name} is of {first.message} for {first.option}, not of {use.message}; set"
                f" {use.option} to another topic",
            )


class NetworkUser:
    """A service on a robot's network, and the topics that it uses."""

    network: Ros2Network
    uses: tuple[TopicUse, ...] = ()

    def unfit(self) -> list[str]:
        """What fits no robot, for warnings."""
        return [problem for _, problem in misfits(self.network, self.uses)]

    def problems(self, graph: Iterable[Announced]) -> Iterator[tuple[str, str]]:
        """By option, what does not fit between it and its network. Raises MisuseError."""
        return mismatches(graph, self.network, self.uses)


def is_of(each: Announced, network: Ros2Network) -> bool:
    """Whether something is announced in the layout and domain of a network."""
    # A bridge for DDS does not announce its domain.
    anywhere = network.layout == "dds"
    return each.layout == network.layout and (anywhere or each.domain == network.domain)


def missing_server(
    graph: Iterable[Announced], network: Ros2Network, service: str, kind: str
) -> str:
    """What to do about a service of a type that nobody serves; "" if somebody does."""
    name = f"/{network.name(service)}"
    servers = [each for each in graph if each.kind == SERVER and is_of(each, network)]
    types = sorted({each.message for each in servers if each.topic == name})
    if kind in types:
        return ""
    text = f"nobody serves {name} of {kind}"
    if types:
        return f"{text}; it is of {_listed(types)}"
    others = sorted({each.topic for each in servers if each.message == kind})
    return f"{text}; {f'the robot has {_listed(others)}' if others else 'start its node'}"


def is_of_robot(each: Announced) -> bool:
    """Whether something is announced by another node than those of services."""
    return not each.node.rpartition("/")[2].startswith(_OWN_NODES)


def _elsewhere(everything: list[Announced], network: Ros2Network) -> tuple[str, str]:
    there = [each for each in everything if is_of_robot(each)]
    for layout in LAYOUTS:
        domains = sorted({each.domain for each in there if each.layout == layout})
        if domains and layout != network.layout:
            return "layout", f'its layout is not {network.layout}; set layout = "{layout}"'
        if domains:
            remedy = f"set domain = {domains[0]}"
            return (
                "domain",
                f"its nodes are in domain {_listed(domains)}, not {network.domain}; {remedy}",
            )
    return "router", nobody(network)


def nobody(network: Ros2Network) -> str:
    """What to do about a network without nodes."""
    return f"no ROS 2 node announces itself there; {_STARTS[network.layout]}"


def _namespace(here: list[Announced], network: Ros2Network, uses: Sequence[TopicUse]) -> str:
    """The namespace in which several topics are that are expected outside of it; "" if none is."""
    if network.namespace.strip("/"):
        return ""
    namespaces = Counter[str]()
    for use in uses:
        wanted, topics = f"/{network.name(use.topic)}", _of_type(_ends(here, use), use)
        if wanted not in topics:
            namespaces.update(each.removesuffix(wanted) for each in topics if each.endswith(wanted))
    ((namespace, count),) = namespaces.most_common(1) or [("", 0)]
    return namespace if count > 1 else ""


def _ends(here: list[Announced], use: TopicUse) -> list[Announced]:
    other = SUBSCRIPTION if use.sends else PUBLISHER
    return [each for each in here if each.kind == other]


def _of_type(ends: list[Announced], use: TopicUse) -> list[str]:
    return sorted({each.topic for each in ends if each.message == use.message})


def _problem(here: list[Announced], network: Ros2Network, use: TopicUse, namespace: str) -> str:
    wanted, ends = f"/{network.name(use.topic)}", _ends(here, use)
    there = [each for each in ends if each.topic == wanted]
    fitting = [each for each in there if each.message == use.message]
    if fitting:
        return _other_qos(wanted, fitting, use)
    if there:
        return _other_type(wanted, there, ends, use)
    if not use.needed:
        return ""
    text = f"nobody {'subscribes to' if use.sends else 'publishes'} {wanted} of {use.message}"
    within = f"{namespace}{wanted}"
    if namespace and within in _of_type(ends, use):
        return f'{text}; the robot has {within}: set namespace = "{namespace}"'
    return f"{text}; {_remedy(ends, use)}"


_POLICIES: Final = (
    ("lasting", "volatile", "transient_local", "messages from before are missing"),
    ("reliable", "best_effort", "reliable", "lost messages are not repeated"),
)


def _several(here: list[Announced], network: Ros2Network, use: TopicUse) -> str:
    """What to do about nodes that share a topic: sensors, or those that drive a robot."""
    wanted = f"/{network.name(use.topic)}"
    ends = [each for each in here if (each.kind, each.topic) == (PUBLISHER, wanted)]
    if not use.sends:
        ends = [each for each in ends if each.message == use.message]
    nodes = {(each.session, each.node): each.node or each.session for each in ends}
    names = _listed(sorted(nodes.values()))
    if use.exclusive and nodes:
        return (
            f"{wanted} is also published by {names}, and the robot obeys both; stop that node, or"
            " give it a topic of its own with a multiplexer such as twist_mux"
        )
    if use.sends or len(nodes) < 2 or use.message in (TRANSFORMS, DETECTIONS):
        return ""
    return (
        f"{wanted} is published by {names}; give each a topic or namespace of its own, and use one"
        " process for each"
    )


def _other_qos(wanted: str, there: list[Announced], use: TopicUse) -> str:
    """What the subscriptions ask for, but the publishers do not offer."""
    qos = f"{use.option}.qos" if use.option.startswith(EVENTS) else f"qos.{use.name}"
    for name, weak, strong, why in _POLICIES:
        ours, theirs = getattr(use.qos, name), [getattr(each.qos, name) for each in there]
        if use.sends and not ours and any(theirs):
            return (
                f"{wanted} is sent as {weak}, but subscribed to as {strong}, so {why};"
                f" add {strong} to {qos}"
            )
        if not use.sends and ours and not any(theirs):
            return (
                f"{wanted} is published as {weak}, not {strong}, so {why};"
                f" make its publisher {strong}, or add {weak} to {qos}"
            )
    return ""


def _other_type(wanted: str, there: list[Announced], ends: list[Announced], use: TopicUse) -> str:
    types = {each.message for each in there}
    text = f"{wanted} is of {_listed(sorted(types))}, not of {use.message}"
    if use.sends and types & {TWIST, TWIST_STAMPED}:
        return f"{text}; set stamped = {'true' if TWIST_STAMPED in types else 'false'}"
    for message in sorted(types & use.others.keys()):
        return f'{text}; set {use.others[message]} = "{use.topic}" instead of {use.option}'
    return f"{text}; {_remedy(ends, use)}"


def _remedy(ends: list[Announced], use: TopicUse) -> str:
    known = [topic for topic in _of_type(ends, use) if topic.endswith(use.suffix)]
    if known:
        return f"the robot has {_listed(known)}: {use.set_to(known[0])}"
    return f"the robot has none of this type; start its node, or {use.instead or use.set_to('')}"


def _listed(names: Sequence[object]) -> str:
    more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
    return ", ".join(map(str, names[:_MAX_NAMED])) + more
