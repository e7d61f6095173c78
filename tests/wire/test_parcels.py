"""Parcels between regions and reports to the coordinator: what their receivers refuse."""

from dataclasses import replace

import numpy as np
import pytest

from minerva_bus.errors import ProtocolError, SceneError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame.description import World
from minerva_bus.frame.own_agents import NO_AGENTS
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.regions.for_all import needed_by_all
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.dividing import NOTHING
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.merging import PlacedEvent, Units, agents_in
from minerva_bus.regions.messages import (
    AgainMessage,
    expected_sources,
    from_message,
    packed_pairs,
    sources_in,
    to_message,
)
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.part import PartReceiver, PartSender
from minerva_bus.regions.partition import ByFunction, ById
from minerva_bus.regions.places import packed_places, unpacked_places
from minerva_bus.regions.progress import NO_PROGRESS
from minerva_bus.regions.region import Region
from minerva_bus.regions.routing import Routing
from minerva_bus.regions.schedule import Schedule
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.testing.family import FAMILY_VOCABULARY, Walker, eHit
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.limits import Limits

DECODER = Decoder(FAMILY_VOCABULARY)


def nodes(*names):
    return tuple(Walker(name).string.nodes[0] for name in names)


def parcel(*names, frame=0, places=((7, -1, 2),), events=()):
    return Parcel(frame, 1, 0, Units(places[: len(names)], nodes(*names)), events)


def received(message):
    return from_message(DECODER.parcel(encode(message)), 1, 0)


def test_a_parcel_arrives_as_it_was_sent():
    events = (PlacedEvent([(4,)], eHit(amount=1.0, sender="b", receivers=["a"])),)
    sent = parcel("c", events=events)
    arrived = received(to_message(sent))
    assert isinstance(arrived, Parcel)
    assert replace(arrived, events=()) == replace(sent, events=(), units=arrived.units)
    assert (list(arrived.units.places), arrived.units.scene) == ([(7, -1, 2)], sent.units.scene)
    assert [(each.places, each.event) for each in arrived.events] == [([(4,)], events[0].event)]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"places": b"\1"}, "places has 1 bytes, which are not 1 places"),
        ({"places": packed_places([(1,), (2,)])}, "which are not 1 places"),
        ({"places": packed_places([(1, 2)])}, "an odd number of numbers"),
        ({"events": (eHit(amount=1.0),), "senders": packed_places([(1,)])}, "eHit has no sender"),
        ({"senders": packed_places([(1,)])}, "senders has 12 bytes, which are not 0 places"),
        ({"string": Scene(nodes("c", "c")), "places": packed_places([(1,), (2,)])}, "c"),
    ],
)
def test_a_message_with_contradictions_is_refused(change, problem):
    with pytest.raises((ProtocolError, SceneError), match=problem):
        received(replace(to_message(parcel("c")), **change))


def test_a_length_that_does_not_fit_is_refused():
    with pytest.raises(ProtocolError, match="not 1 places"):
        unpacked_places(b"\xff\xff\xff\xff", 1, "places")


def region_of(name, state):
    return int(name.startswith("z"))


@pytest.fixture
def region():
    world = World("w", Scene(nodes("a", "b")), FAMILY_VOCABULARY, frames=9)
    region = Region(world, 0, ByFunction(2, region_of))
    InProcessRunner(region.algorithm, ()).start()
    region.algorithm.frame = 1
    region.receive(Parcel(0, 0, 0, Units((), ()), ()))
    return region


@pytest.mark.parametrize(
    ("arriving", "problem"),
    [
        (parcel("a"), "region 1 has sent #a, which is here already, in its parcel of frame 0"),
        (parcel("z"), "region 1 has sent AWalker, which does not belong here"),
        (parcel("c", places=((1,),)), "two nodes have the same place"),
    ],
)
def test_an_agent_that_cannot_move_here_is_refused(region, arriving, problem):
    region.expect({0: [1]})
    region.receive(arriving)
    with pytest.raises(ProtocolError, match=problem):
        region.enter()


def test_a_parcel_from_the_future_is_refused(region):
    region.expect({0: [1]})
    assert region.missing == [1]
    with pytest.raises(ProtocolError, match="it is of frame 2, expected at most 1"):
        region.receive(parcel(frame=2))


def test_a_parcel_that_its_sender_has_not_reported_is_refused(region):
    region.expect({0: []})
    region.receive(parcel("c"))
    with pytest.raises(
        ProtocolError, match="region 1 has sent a parcel of frame 0 that it has not"
    ):
        region.enter()


def test_events_of_one_sender_for_all_regions_stay_together(region):
    sent = [
        PlacedEvent([(1,)], eHit(amount=1.0, sender="a", receivers=["b"])),
        PlacedEvent([(2,)], eHit(amount=2.0, sender="b", receivers=["a"])),
        PlacedEvent([(1,)], eHit(amount=3.0, sender="a", receivers=["z"])),
    ]
    routing = Routing(0, region.partition, region.algorithm.composition, {})
    for_all, others = routing.for_all(sent)
    assert [each.event for each in for_all] == [sent[0].event, sent[2].event]
    assert [each.event for each in others] == [sent[1].event]


def hits(*receivers):
    """A batch: what #a sends to each of these agents."""
    events = [
        eHit(amount=float(row), sender="a", receivers=[to]) for row, to in enumerate(receivers)
    ]
    return PlacedEvent([(row,) for row in range(len(receivers))], Events.of(events))


def in_rows(routed):
    """By region, the places and the events of all rows."""
    return {
        region: [(place, event) for each in placed for place, event in rows_of(each)]
        for region, placed in routed.items()
    }


def rows_of(placed):
    return list(zip(placed.places, list(placed.event), strict=True))


def test_rows_of_a_batch_go_to_the_regions_of_their_receivers(region):
    composition = region.algorithm.composition
    routing = Routing(0, ById(3), composition, {"b": 2})
    sent = hits("a", "b", "z", "a")
    a, b, elsewhere, again = rows_of(sent)
    assert in_rows(routing.route([sent])) == {
        0: [a, elsewhere, again], 1: [elsewhere], 2: [b, elsewhere]
    }  # fmt: skip
    near = hits("a", "b")
    assert in_rows(routing.route([near])) == {0: rows_of(near)[:1], 2: rows_of(near)[1:]}
    # Receivers may move until a late event counts.
    assert in_rows(routing.route([near], late=True)) == dict.fromkeys(range(3), rows_of(near))
    assert routing.keep([sent]) == {0: [sent]}


def test_events_of_a_batch_for_all_regions_are_its_rows_for_agents_elsewhere(region):
    routing = Routing(0, region.partition, region.algorithm.composition, {})
    sent = hits("a", "z", "b")
    here, elsewhere, also_here = rows_of(sent)
    for_all, others = routing.for_all([sent])
    assert [row for each in for_all for row in rows_of(each)] == [elsewhere]
    assert [row for each in others for row in rows_of(each)] == [here, also_here]
    only_here = [hits("a", "b")]
    assert routing.for_all(only_here) == ([], only_here)


def test_rows_of_a_placed_event_have_their_places():
    sent = hits("a", "b", "c")
    assert rows_of(sent.take(np.array([2, 0]))) == [rows_of(sent)[2], rows_of(sent)[0]]


ANSWER = encode(to_message(Replies(4, 1, 0, {})))


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"\xc1", "region 1 has sent invalid events: "),
        (ANSWER, "expected a parcel of frame 4 with events only"),
        (encode(to_message(parcel("c", frame=4))), "expected a parcel of frame 4 with events only"),
        (encode(to_message(parcel(frame=3))), "expected a parcel of frame 4 with events only"),
        (encode(AgainMessage(4)), "expected a parcel of frame 4 with events only"),
    ],
)
def test_what_is_for_all_regions_must_be_events_of_the_last_frame(data, problem):
    request = m.RegionRequest(5, (b"",), for_all=(b"", data))
    with pytest.raises(WorldStopped, match=problem):
        needed_by_all(DECODER, request, NO_AGENTS)


EARLY = (PlacedEvent([(1,)], eHit(amount=1.0, sender="c")),)


def test_regions_that_run_ahead_send_only_postponed_events():
    """Others, and agents, are for frames before which agents move: here frames 0, 3 and 6."""
    lag = RegionLag(2, ById(2), 3)
    world = World("w", Scene(nodes("a", "b")), FAMILY_VOCABULARY, frames=9, lag=lag)
    region = Region(world, 0, ById(2), ahead=2)
    InProcessRunner(region.algorithm, ()).start()
    late = received(to_message(Parcel(0, 1, 0, NOTHING, (), postponed=EARLY)))
    for wrong in (parcel("c"), parcel(events=EARLY)):
        with pytest.raises(ProtocolError, match="it is for frame 1, which does not wait for it"):
            region.receive(wrong)
    assert region.receive(late)
    assert not region.receive(late)
    assert region.receive(parcel("c", frame=2))
    with pytest.raises(ProtocolError, match="it is of frame 3, expected at most 2"):
        region.receive(parcel(frame=3))


def test_a_frame_needs_parcels_of_as_many_frames_before_as_regions_run_ahead():
    schedule = Schedule(5, 2)
    new = [[*schedule.new(frame)] for frame in range(12)]
    assert new == [[], [], [], [0], [1], [2, 3, 4], [], [], [5], [6], [7, 8, 9], []]
    assert [schedule.last(frame) for frame in range(11)] == [2, 3, 4, 4, 4, 7, 8, 9, 9, 9, 12]
    request = m.RegionRequest(5, (packed_pairs([(1,), (0,)]), b"", packed_pairs([(), (0,)])))
    assert expected_sources(schedule, request, 0) == {2: [1], 3: [], 4: [1]}
    with pytest.raises(ProtocolError, match="expected those of 0 frames, not 3"):
        expected_sources(schedule, replace(request, frame=6), 0)


@pytest.mark.parametrize("pairs", [b"\0\0", packed_pairs([(), (1, 0)])[:-1]])
def test_a_request_without_whole_pairs_is_refused(pairs):
    with pytest.raises(ProtocolError, match="bytes are not pairs of uint16"):
        sources_in(pairs, 0)


def test_a_request_for_parcels_of_unknown_regions_is_refused(region):
    assert sources_in(packed_pairs([(), (), (1, 0)]), 0) == [2]
    with pytest.raises(ProtocolError, match=r"parcels of regions \[2\]: some do not exist"):
        region.expect({0: [2]})


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"kept": b"\1"}, "kept must be a list of int32"),
        ({"kept": b"\1\0\0\0"}, "kept must be from -1 to 0"),
        ({"changed": {}}, "piece 0 must be given"),
        ({"changed": {"0": Scene(nodes("b"))}}, "piece 1 must be given"),
        (
            {"changed": {"0": Scene(nodes("b", "c", "d"))}},
            "1 more pieces are given than are new at 2",
        ),
        ({"kept": bytes(4), "changed": {}}, "which are not 1 places"),
        ({"places": packed_places([(1,)])}, "which are not 2 places"),
        ({"places": b""}, "expected places of 2 nodes, got 1"),
        ({"senders": packed_places([(1,)])}, "which are not 0 places"),
        ({"parcels": b"\1"}, "parcels must be a list of uint16"),
        ({"rejected": b"\1"}, "rejected must be a list of int32"),
        ({"rejected": bytes(4)}, "rejected has numbers of none of 0 events"),
        ({"counts": {"broken": {}}}, "expected broken and lately"),
        ({"counts": {"broken": {"loud": "x"}, "lately": {}}}, "expected a number for 'loud'"),
        ({"counts": {"broken": {}, "lately": {"loud": [1]}}}, "loud has no list of frames"),
    ],
)
def test_a_report_with_contradictions_is_refused(change, problem):
    receiver = PartReceiver(Units([(3,)], nodes("a")))
    report = PartSender().message(
        0, Units([(3,), (4,)], nodes("b", "c")), [], NO_PROGRESS, [1], b""
    )
    with pytest.raises(ProtocolError, match=problem):
        receiver.apply(DECODER.part(encode(replace(report, **change))))


def test_new_pieces_beside_each_other_are_one_string_of_a_report():
    before, receiver = nodes(*"abcdefg"), PartReceiver(Units((), ()))
    places, sender = [(number,) for number in range(7)], PartSender()
    after = (before[0], *nodes("h", "i"), before[4], *nodes("j"), before[6], *nodes("k"))
    reported = []
    for frame, pieces in enumerate((before, after)):
        report = sender.message(frame, Units(places, pieces), [], NO_PROGRESS, [], b"")
        receiver.apply(DECODER.part(encode(report)))
        assert receiver.units.pieces == pieces
        reported.append({at: len(scene.pieces) for at, scene in report.changed.items()})
    assert reported == [{"0": 7}, {"1": 2, "4": 1, "6": 1}]


# --- limits ---

TIGHT = Decoder(FAMILY_VOCABULARY, Limits(region_values=100, tick_values=100, answer_bytes=4000))
CROWD = [f"n{number}" for number in range(40)]


def crowd(*places):
    return parcel(*CROWD, places=[(number, *places) for number in range(len(CROWD))])


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        (crowd(), "parcel has at least 101 values, over 100; .* raise region_values in"),
        (
            parcel("c", places=[tuple(range(51))]),
            "103 numbers of four bytes, over 100; raise region",
        ),
        (parcel("c", places=[tuple(range(999))]), "bytes, over 4000; raise answer_bytes in"),
    ],
)
def test_a_parcel_over_a_limit_is_refused_unless_there_are_so_many_agents(sent, problem):
    data = encode(to_message(sent))
    with pytest.raises(ProtocolError, match=problem):
        TIGHT.parcel(data)
    arrived = from_message(TIGHT.parcel(data, agents_in(lambda: [sent.units])), 1, 0)
    assert isinstance(arrived, Parcel)
    assert arrived.units == sent.units


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"kept": bytes(404)}, "101 numbers of four bytes, over 100; raise region_values in"),
        (
            {"inputs": bytes([0x90] * 200)},
            "101 values of events of generators, over 100; raise tick_",
        ),
        ({"senders": bytes(404)}, "101 numbers of four bytes, over 100; raise region_values in"),
    ],
)
def test_a_report_over_a_limit_is_refused(change, problem):
    message = PartSender().message(0, Units((), ()), (), NO_PROGRESS, (), b"")
    with pytest.raises(ProtocolError, match=problem):
        TIGHT.part(encode(replace(message, **change)))
