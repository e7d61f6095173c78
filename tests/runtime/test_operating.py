"""Pausing, stepping, pacing, restarting and reading the logs of running worlds."""

import json
from contextlib import nullcontext
from unittest.mock import Mock

import pytest
import zenoh
from running import World, eventually, here, write_world

from minerva_bus.cli import operation as operating
from minerva_bus.cli.options import WorldTarget
from minerva_bus.errors import BusError, ProtocolError
from minerva_bus.grammar.events import Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.runtime.metrics import EventLog
from minerva_bus.wire.codec import Decoder

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"

[process.screen]
service = "yard:Screen"
on_failure = "ignore"
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("operated")
    with World(write_world(folder, MEMBERS, frames=0, rate=20)) as world:
        world.runs("steps", "walkers", "screen")
        yield world


@pytest.fixture
def operator(world):
    with world.client() as asked:
        yield asked.operator
        asked.operator.set_rate(50.0)
        asked.operator.resume()


def told(world, *words):
    done = here(world.folder, *words)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_paused_world_stands_still_and_steps(world, operator):
    frame = int(told(world, "pause").split()[-1])
    status = operator.status()
    assert (status.frame, status.paused, status.phase) == (frame, True, "between frames")
    assert told(world, "step", "3") == f"{world.name}: paused before frame {frame + 3}\n"
    assert told(world, "step") == f"{world.name}: paused before frame {frame + 4}\n"
    assert operator.status().frame == frame + 4
    told(world, "resume")
    eventually(lambda: operator.status().frame > frame + 10, "it goes on")


def test_steps_add_up(operator):
    operator.pause()
    eventually(lambda: operator.status().phase == "between frames", "it rests")
    before = operator.status().frame
    for _ in range(5):
        operator.step()
    eventually(lambda: operator.status().frame == before + 5, "five frames")


def test_the_rate_changes(world, operator):
    told(world, "rate", "5")
    eventually(lambda: operator.status().hz < 6, "slower")
    told(world, "rate", "200")
    # Far below 200: a busy machine is slower.
    eventually(lambda: operator.status().hz > 15, "faster")
    assert operator.status().rate == 200.0


def test_a_status_has_phases_and_events(operator):
    def measured():
        status = operator.status()
        return (
            status
            if {"tick", "evolve", "frame"} <= status.phases.keys() and status.events
            else None
        )

    status = eventually(measured, "measured")
    assert status.events["eStep"] > 0
    assert status.happenings[-1].number >= len(status.happenings)
    later = operator.status(status.happenings[-1].number).happenings
    assert all(happening.number > status.happenings[-1].number for happening in later)


def test_a_member_is_restarted(world, operator):
    before = {member.name: member.pid for member in operator.status().members}
    assert told(world, "restart", "walkers") == f"{world.name}: restarting walkers\n"

    def successor():
        now = {member.name: member for member in operator.status().members}["walkers"]
        return now.state == "present" and now.pid != before["walkers"]

    eventually(successor, "another process")
    lines = [json.loads(line) for line in told(world, "logs", "walkers", "--json").splitlines()]
    assert "restarting on request" in [line["message"] for line in lines]
    assert {line["member"] for line in lines} == {"walkers"}
    assert "walkers │ restarting on request" in told(world, "logs")


@pytest.mark.parametrize("answers", [0, 2])
def test_following_a_silent_world_ends_with_it(answers, monkeypatch):
    asked = Mock(world="quiet")
    asked.operator.logs.side_effect = [[]] * answers + [BusError("no world answers")]
    asked.operator.status.return_value.members = []
    monkeypatch.setattr(operating, "client", lambda *_: nullcontext(asked))
    with nullcontext() if answers else pytest.raises(BusError):
        operating.show_logs("", True, WorldTarget(), False)


class Declaring:
    """A session, or its liveliness, that gathers the subscribers declared with it."""

    def __init__(self, session, subscribers):
        self.session, self.subscribers = session, subscribers

    def __getattr__(self, name):
        return getattr(self.session, name)

    def liveliness(self):
        return Declaring(self.session.liveliness(), self.subscribers)

    def declare_subscriber(self, *words):
        self.subscribers.append(self.session.declare_subscriber(*words))
        return self.subscribers[-1]


@pytest.mark.parametrize("broken", [False, True])
def test_records_that_end_early_leave_no_subscribers(world, monkeypatch, broken):
    subscribers = []
    with world.client() as asked:
        monkeypatch.setattr(asked, "_session", Declaring(asked._session, subscribers))
        records = asked.records()
        next(records)
        assert len(subscribers) == 2
        if broken:
            monkeypatch.setattr(Decoder, "record", Mock(side_effect=ProtocolError("torn")))
            with pytest.raises(BusError, match=f"the record of '{world.name}' cannot be read"):
                list(records)
        else:
            records.close()
        for subscriber in subscribers:
            with pytest.raises(zenoh.ZError, match="Undeclared"):
                subscriber.undeclare()


def test_a_world_continues_while_a_view_restarts(world, operator):
    frame = operator.status().frame
    told(world, "restart", "screen")
    eventually(lambda: operator.status().frame > frame + 20, "it goes on")
    assert "the world waits for it" not in told(world, "logs", "screen")


def test_a_fragment(operator):
    assert operator.fragment("a").startswith("AWalker#a<")


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (("restart", "nobody"), "there is no member 'nobody'"),
        (("logs", "walker"), "did you mean 'walkers'"),
        (("rate", "2e9"), "rate must be frames per second"),
        (("step", "0"), "greater than or equal to 1"),
        (("pause", "nowhere"), "no world 'nowhere' runs on this machine"),
        (("top",), "top needs a terminal"),
    ],
)
def test_invalid_input_is_reported(world, words, problem):
    done = here(world.folder, *words)
    assert done.returncode == 2
    assert problem in done.stderr
    assert "Traceback" not in done.stderr


def test_top_as_json(world):
    answer = json.loads(told(world, "top", "--json"))
    assert answer["world"] == world.name
    assert answer["phases"]["frame"] > 0


def test_the_log_reads_only_the_events_of_a_batch_that_it_keeps(monkeypatch):
    texts, read = Ids.texts, []
    monkeypatch.setattr(Ids, "texts", lambda ids: read.append(len(ids)) or texts(ids))
    log = EventLog()
    log.frame(3, [Events("eGo", (), (), 1000, receivers=Ids.numbered("a", range(1000)))])
    assert [entry.text for entry in log.entries(0)] == [
        "eGo to #a0", "eGo to #a1", "eGo: 1000 of them in this frame",
    ]  # fmt: skip
    assert max(read) == 2
