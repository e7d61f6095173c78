"""Strategies for every message of the protocol, with any vocabulary."""

from dataclasses import fields, is_dataclass

import hypothesis.strategies as st
import numpy as np

from minerva_bus.frame import messages as m
from minerva_bus.grammar.scene import AgentNode, Scene, rebuild, rescoped
from minerva_bus.testing.strategies import (
    events_of,
    ids,
    integers,
    names,
    reals,
    strings_of,
    texts,
    vocabularies,
)
from minerva_bus.world.readings import Scan, Sighting, Sightings
from minerva_bus.world.services import Participation, When

numbers = st.integers(0, (1 << 63) - 1)
members = names()
conditions = ("", "energy > 0.5", 'name == "x" and alive == true')


def plain_data(leaves=None):
    """Data that a member may save: plain values in maps and lists."""
    if leaves is None:
        leaves = st.none() | st.booleans() | integers() | reals() | texts() | st.binary()
    return st.recursive(
        leaves, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts(), inner, max_size=3),
        max_leaves=6,
    )  # fmt: skip


saved = st.none() | st.dictionaries(texts(), plain_data(), max_size=3)
figures = st.dictionaries(texts(), st.booleans() | integers() | reals() | texts(), max_size=4)
lines = texts().filter(str.isprintable)
about = st.dictionaries(lines, st.booleans() | integers() | reals() | lines, max_size=4)


def without_agents(scene):
    def leave(node, scope):
        return scope if isinstance(node, AgentNode) else rescoped(node, scope)

    return rebuild(scene, leave)


def with_slots(scene):
    """The string with each outermost agent reduced to `A#id()`."""

    def leave(node, scope):
        bare = isinstance(node, AgentNode)
        return AgentNode(node.symbol, node.id) if bare else rescoped(node, scope)

    return rebuild(scene, leave)


def from_member(vocabulary):
    """Messages to the coordinator."""
    strings, events = (
        strings_of(vocabulary),
        st.lists(events_of(vocabulary, ["a", "b"], conditions)),
    )
    parts = st.dictionaries(ids(), strings, max_size=3)
    views = st.dictionaries(ids(), strings.map(without_agents), max_size=3)
    event_tuples = events.map(tuple)
    few = st.lists(names(), max_size=3).map(tuple)
    asked, every = st.sampled_from(Participation), st.integers(0, 10**18 - 1)
    rates = st.floats(0, allow_infinity=False, exclude_min=True)
    whens = st.builds(When, asked, every) | st.builds(When, asked, st.just(0), rates)
    shown = st.dictionaries(names(), views, max_size=2)
    return st.one_of(
        st.builds(
            m.Hello, member=members, version=numbers,
            kinds=st.lists(st.sampled_from(sorted(vocabulary.kinds)), max_size=2, unique=True).map(
                lambda symbols: tuple(vocabulary.kinds[symbol] for symbol in symbols)
            ),
            generates=few, when=whens, orders=few, draws=few, coupled=st.booleans(),
            topics=few, publishes=few, people=st.booleans(), plain=st.booleans(), about=about,
        ),
        st.builds(m.TickReply, members, numbers, event_tuples, saved),
        st.builds(
            m.EvolveReply, members, numbers, numbers, parts,
            st.dictionaries(ids(), event_tuples, max_size=2), shown,
        ),
        st.builds(m.Emitted, members, event_tuples),
        st.builds(m.Failed, members, st.integers(-1, 1 << 40), texts(), texts()),
        st.builds(m.Resync, members, texts()),
        st.builds(m.Leaving, members),
        st.builds(m.MemberMetrics, members, figures),
        st.builds(m.Report, members, figures),
    )  # fmt: skip


def to_member(vocabulary):
    """Messages of the coordinator."""
    strings, events = (
        strings_of(vocabulary),
        st.lists(events_of(vocabulary, ["a", "b"], conditions)),
    )
    event_tuples = events.map(tuple)
    few = st.lists(ids(), max_size=3).map(tuple)
    parts = st.dictionaries(ids(), strings, max_size=3)
    views = st.dictionaries(ids(), strings.map(without_agents), max_size=3)
    return st.one_of(
        st.just(m.Greet()),
        st.builds(
            m.Welcome, texts(), st.just(vocabulary), integers(), reals(), numbers,
            st.sampled_from(["sequential", "literal"]), saved,
        ),
        st.builds(m.Refused, texts()),
        st.builds(m.Sources, st.dictionaries(names(), few, max_size=3)),
        st.builds(m.TickRequest, numbers),
        st.builds(m.Fragments, parts, few),
        st.builds(m.EvolveRequest, numbers, few, event_tuples, event_tuples, numbers, few),
        st.builds(
            m.ViewShown, names(), numbers, numbers, views, st.none() | strings.map(with_slots)
        ),
        st.builds(m.Orders, numbers, event_tuples),
        st.builds(m.Repeat, names()),
        st.builds(m.Stop, texts()),
    )  # fmt: skip


def records(vocabulary):
    """Records of frames."""
    event_tuples = st.lists(events_of(vocabulary, ["a", "b"], conditions)).map(tuple)
    parts = st.dictionaries(ids(), strings_of(vocabulary), max_size=3)
    return st.builds(
        m.FrameRecord, numbers, event_tuples, parts, st.binary(min_size=16, max_size=16)
    )


scans = st.builds(
    lambda ranges, robot, rest: Scan(robot, np.array(ranges, np.float32), *rest),
    st.lists(st.floats(0, 100, width=32), max_size=5),
    texts(),
    # first, step, range_max, time and the mount: beams have different directions and a range.
    st.tuples(reals(), reals().filter(bool), reals().map(abs).filter(bool), *[reals()] * 4),
)
sightings = st.builds(
    Sightings, texts(), st.lists(st.builds(Sighting, texts(), reals(), reals())).map(tuple), reals()
)
readings = st.builds(
    m.Readings, members, names(), st.integers(-1, 1 << 40),
    st.lists(scans | sightings, max_size=3).map(tuple),
)  # fmt: skip

spoken = vocabularies().flatmap(lambda v: st.tuples(st.just(v), from_member(v)))
heard = vocabularies().flatmap(lambda v: st.tuples(st.just(v), to_member(v)))
recorded = vocabularies().flatmap(lambda v: st.tuples(st.just(v), records(v)))


def same(left, other):
    """Equality of messages; vocabularies by their content, arrays by their values."""
    if is_dataclass(left) and not isinstance(left, Scene) and type(left).__eq__ is object.__eq__:
        pairs = [(getattr(left, f.name), getattr(other, f.name)) for f in fields(left)]
        return type(left) is type(other) and all(same(*pair) for pair in pairs)
    if isinstance(left, np.ndarray):
        return left.dtype == other.dtype and left.tobytes() == other.tobytes()
    if isinstance(left, tuple):
        return len(left) == len(other) and all(map(same, left, other))
    return left == other
