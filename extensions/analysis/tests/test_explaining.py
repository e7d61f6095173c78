"""`minerva explain RECORD`: the causes of values, over ready-made worlds and a small one."""

import json

import pytest

from minerva_analysis import explain
from minerva_analysis.causes import observe_agent
from minerva_analysis.past_frames import last_change
from minerva_bus import Agent, EventType, World, each, on, record
from minerva_bus.errors import MinervaError, RecordError
from minerva_bus.log import chunks
from minerva_bus.log.record import Record
from tests.log.harbour import Crew, Pilot, Port, Raft, Ship, eCargo, eSail, harbour
from tests.log.recorded_runs import bytes_of, record_of
from tests.runtime.running import here

SCREEN = 30
"""Lines of a screenful."""

RUNS = {
    "meadow": {"frames": 60},
    "robot": {"frames": 12},
    "warehouse": {"frames": 60},
    "traffic": {"frames": 60},
    "flock": {"frames": 5, "birds": 40},
    "plants": {"frames": 7},
}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    folder = tmp_path_factory.mktemp("explained")
    for name, settings in RUNS.items():
        record(name, folder / f"{name}.mcap", quiet=True, **settings)
    with harbour().start(record=folder / "harbour.mcap") as live:
        live.step(2)
        live.publish(eCargo(7, receivers=("s1",)), by="bert")
        live.step(1)
        live.publish(eSail(30.0, receivers=("s1", "s2")), by="anna")
        live.step(3)
        live.publish(eSail(300.0, receivers=("s1",)), by="anna")
        live.publish(eCargo(60, receivers=("s2",)))
        live.step(10)
    return folder


def explained(records, name, agent, attribute, frame=None):
    world = harbour() if name == "harbour" else ""
    explanation = explain(records / f"{name}.mcap", agent, attribute, frame, world)
    assert len(explanation.lines()) <= SCREEN
    return explanation


def chain(explanation):
    """Frame, agent, method and event of each link, as text."""
    return [
        f"{link.frame} #{link.agent} {link.method} {link.event.partition('<')[0]}"
        for link in explanation.links
    ]


ORDERED = (
    "the generator cranes sent eCargo for frame 4, for the order eCargo<tons=7> to #s1 in frame 2"
    " of the person bert"
)
CHANGES = [
    # A method of the agent, called for an event of a generator.
    ("meadow", "f1", "energy", None, ["59 #f1 Fox.prowl eStep"], "generator steps"),
    ("meadow", "f1", "births", None, [], "initial string"),
    ("robot", "r1", "objective", None, ["0 #r1 ARobot.set_objective eObjective"], "gObjective"),
    ("robot", "r1", "angle", None, ["11 #r1 ARobot.decide eDecide"], "generator gDecide"),
    ("traffic", "c21", "speed", None, ["59 #c21 Car.drive eStep"], "generator steps"),
    ("traffic", "c21", "speed", 20, ["19 #c21 Car.drive eStep"], "for frame 19"),
    ("warehouse", "carrier2", "heading", None, ["50 #carrier2 Carrier.live eStep"], "steps"),
    # Of a population, by arrays.
    ("flock", "b3", "x", None, ["4 #b3 Bird.steer eNear"], "generator neighbours"),
    # Messages between agents.
    (
        "warehouse", "carrier1", "talks", None,
        ["23 #carrier1 Talker.listen eMessage", "22 #manager Manager.manage eStep"],
        "generator steps sent eStep for frame 22",
    ),
    (
        "traffic", "c21", "stop", None,
        ["1 #c21 Car.notice eLight", "0 #lights Lights.change eStep"],
        "generator steps sent eStep for frame 0",
    ),
    (
        "harbour", "port", "answers", None,
        ["12 #port Port.count eSignal", "11 #pilot Pilot.answer eSignal", "10 #port Port.watch eTide"],
        "sent eTide for frame 10",
    ),
    ("harbour", "pilot", "calls", 8, ["6 #pilot Pilot.answer eSignal", "5 #port Port.watch eTide"], "frame 5"),
    # Sanctions of norms.
    ("traffic", "c22", "fined", None, ["54 #c22 Car.pay eFine"], "the norm speed_limit punishes"),
    ("traffic", "c22", "wish", None, ["54 #c22 Car.pay eFine"], "in frame 53"),
    # Births, and agents around others.
    ("plants", "bush:2", "length", None, ["0 #bush:2 Bud.grow eGrow"], "generator seasons"),
    ("harbour", "s1:1", "afloat", 12, ["9 #s1:1 Ship.shelter eWind"], "generator weather"),
    ("harbour", "c1", "below", None, ["9 #c1 Ship.shelter eWind"], "generator weather"),
    # People: directly, and through a generator that takes their orders.
    ("harbour", "s2", "x", None, ["3 #s2 Ship.sail eSail"], "the person anna sent eSail for frame 3"),
    ("harbour", "s1", "tons", None, ["4 #s1 Ship.load eCargo"], ORDERED),
    ("harbour", "s2", "tons", None, [], "initial string"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "agent", "attribute", "frame", "links", "origin"), CHANGES,
    ids=[f"{name}-{agent}-{attribute}" for name, agent, attribute, *_ in CHANGES],
)  # fmt: skip
def test_the_cause_of_a_value(records, name, agent, attribute, frame, links, origin):
    explanation = explained(records, name, agent, attribute, frame)
    assert chain(explanation) == links
    assert origin in explanation.origin


def test_the_line_that_sets_the_attribute_is_shown(records):
    (link,) = explained(records, "harbour", "s2", "x").links
    assert link.place.shown == ("self.x = sail.x",)
    assert link.place.file.endswith("harbour.py")
    assert link.perceived == (("eSail", 1),)


def test_rejections_are_listed_with_their_norms(records):
    sailed = explained(records, "harbour", "s1", "x", frame=8)
    assert sailed.value == "30"
    assert sailed.rejected == (
        "frame 6: the norm inshore rejected eSail<x=300> to #s1, sent by the person anna",
    )
    loaded = explained(records, "harbour", "s2", "tons", frame=10)
    assert loaded.rejected == ("frame 8: the norm draught rejected the step of #s2",)


def test_an_agent_whose_code_is_missing_is_explained_by_its_events(records):
    path, world = records / "harbour.mcap", harbour([Port, Ship, Raft, Crew])
    links = explain(path, "pilot", "calls", 8, world).links
    assert [(link.method, link.event) for link in links] == [
        ("", 'eSignal<text="come">'), ("Port.watch", "eTide"),
    ]  # fmt: skip
    assert links[0].remark == "the code of APilot is not Python here"


def test_changed_code_is_noticed(records):
    class Drifting(Agent, symbol="AShip"):
        x: float = 0.0
        tons: int = 0
        births: int = 0

        @on("eCargo")
        def load(self, cargo, moment):
            self.tons += cargo.tons

        @on("eWind")
        def stand(self, wind, moment):
            pass

        @on("eSail")
        def drift(self, sail, moment):
            self.x = sail.x + 1.0

    path, world = records / "harbour.mcap", harbour([Port, Pilot, Drifting, Raft, Crew])
    (link,) = explain(path, "s2", "x", None, world).links
    assert link.method.endswith("Drifting.drift")
    assert link.remark == "the code computes another value now: it has changed since the run"


def test_the_search_for_an_old_value_unpacks_chunks_at_most_twice(tmp_path, monkeypatch):
    unpacked, unpack = [], chunks._unpacked
    with record_of(bytes_of("meadow"), tmp_path) as recorded:
        monkeypatch.setattr(
            chunks,
            "_unpacked",
            lambda file, place: unpacked.append(place.begin) or unpack(file, place),
        )
        assert last_change(recorded, "f1", "births", 60).frame == -1
    assert len(unpacked) > 5
    # Once while a keyframe is looked for, and once more for the frames after an earlier one.
    assert len(unpacked) <= 2 * len(set(unpacked))


@pytest.mark.parametrize(
    ("agent", "attribute", "frame", "why"),
    [
        ("s3", "x", None, "no agent #s3; there are port, pilot, s1, c1, s2"),
        ("s1", "tonns", None, "no attribute 'tonns'; did you mean 'tons'?"),
        ("s1", "x", 99, "it has frames 0 to 15, not 99"),
        ("s1:1", "afloat", None, "#s1:1 disappeared in frame 14; --frame 14 explains"),
    ],
)
def test_what_is_missing_is_named(records, agent, attribute, frame, why):
    with pytest.raises(RecordError) as error:
        explained(records, "harbour", agent, attribute, frame)
    assert why in str(error.value)


def test_the_command_prints_text_and_json(records):
    words = ("explain", "warehouse.mcap", "--agent", "carrier1", "--attribute", "talks")
    text = here(records, *words)
    assert text.returncode == 0
    assert "because it received eMessage<" in text.stdout
    plain = json.loads(here(records, *words, "--json").stdout)
    assert plain["since"] == 23
    assert [link["source"]["name"] for link in plain["links"]] == ["manager", "steps"]
    assert plain["links"][0]["place"]["line"] > 0
    missing = here(records, "explain", "warehouse.mcap", "--attribute", "talks")
    assert missing.returncode == 2
    assert "--agent ID is missing; minerva info" in missing.stderr


def test_without_an_attribute_the_agent_is_shown_with_what_it_received_and_what_was_rejected(
    records,
):
    with Record(records / "harbour.mcap") as recorded:
        ship = observe_agent(recorded, {}, "s1", 7)
    assert (ship.kind, ship.frame) == ("AShip", 7)
    assert dict(ship.state)["x"]
    sources = {
        (each.frame, each.event.partition("<")[0]): each.source.text for each in ship.received
    }
    assert sources[3, "eSail"] == "the person anna"
    assert [each.frame for each in ship.received] == sorted(
        (each.frame for each in ship.received), reverse=True
    )
    assert "the norm inshore rejected eSail<x=300> to #s1, sent by the person anna" in "".join(
        ship.rejected
    )
    text = here(records, "explain", "warehouse.mcap", "--agent", "carrier1", "--frame", "24")
    assert text.stdout.startswith("ACarrier#carrier1 at the beginning of frame 24\n")
    assert "frame 23: eMessage<" in text.stdout


def test_a_live_world_explains_a_value_of_its_last_frame(tmp_path):
    with harbour().start(record=tmp_path / "live.mcap") as live:
        live.step(3)
        live.publish(eSail(30.0, receivers=("s1",)), by="anna")
        live.step(2)
        answer = explain(live, "#s1", "x")
        assert (answer.frame, chain(answer)) == (5, ["3 #s1 Ship.sail eSail"])
        assert "the person anna" in answer.origin
        assert explain(live, "s1", "x", 2).frame == 2
        with pytest.raises(MinervaError, match="the attribute is empty"):
            explain(live, "s1", "")
    with harbour().start() as unrecorded, pytest.raises(MinervaError, match="neither its journal"):
        explain(unrecorded, "s1", "x")


def test_a_record_of_another_world_is_refused(records):
    with pytest.raises(MinervaError, match="another world"):
        explain(records / "meadow.mcap", "f1", "energy", world="traffic")


eFill, eLeak = EventType("eFill"), EventType("eLeak")


class Pot(Agent, symbol="APot"):
    water: float = 1.0

    @on("eFill")
    def fill(self, _filled, _moment):
        self.water += 3.0

    @on("eLeak")
    def leak(self, _leak, _moment):
        self.water -= 0.5


def test_earlier_changes_of_a_frame_are_shown(tmp_path):
    world = World("APot#p", agents=[Pot], services=[each(eFill), each(eLeak)])
    record(world, tmp_path / "pot.mcap", frames=2, quiet=True)
    lines = explain(tmp_path / "pot.mcap", "p", "water", 1, world).lines()
    assert any(line.strip().startswith("in Pot.leak") for line in lines)
    assert "  earlier in this frame: 4 by Pot.fill (eFill)" in lines
