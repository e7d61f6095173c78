"""Processes of a world: the resources for them, their number, and how many start at a time."""

from __future__ import annotations

import resource

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Agent, Device, EventType, Generator, Vocabulary, World, on, run
from minerva_bus.api.world import request_of
from minerva_bus.errors import MisuseError, WorldFileError
from minerva_bus.frame.placement import HOST_SECONDS, hosts_for
from minerva_bus.launch import world_files
from minerva_bus.launch.machine_resources import (
    BASE_FILES,
    BYTES_PER_PROCESS,
    FILES_PER_PROCESS,
    THREADS_PER_PROCESS,
    Headroom,
    check_capacity,
    cores,
    shortage,
)
from minerva_bus.launch.process_table import SLOT_SECONDS, StartQueue
from minerva_bus.launch.world_files import (
    AGENT_SECONDS,
    ROW_SECONDS,
    read_world_text,
)
from minerva_bus.settings.world_settings import Overrides


def test_without_limits_everything_fits():
    assert shortage(1000, Headroom()) == ""


@pytest.mark.parametrize(("name", "enough", "said"), [
    ("files", 500 * FILES_PER_PROCESS + BASE_FILES, "open files in one process"),
    ("threads", 500 * THREADS_PER_PROCESS, "threads"),
    ("bytes", 500 * BYTES_PER_PROCESS, "MiB of memory"),
])  # fmt: skip
def test_the_scarce_resource_is_named(name, enough, said):
    assert shortage(500, Headroom(**{name: enough})) == ""
    assert said in shortage(500, Headroom(**{name: enough - 1}))


def test_a_few_processes_need_open_files_too(monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 20))
    with pytest.raises(MisuseError, match=r"6 processes cannot start here: .* 20 are allowed"):
        check_capacity(6)
    # The soft limit is raised as far as the hard limit allows.
    raised = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: (20, 40))
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: raised.append(limits))
    check_capacity(6)
    assert raised == [(40, 40)]


def test_there_is_a_core():
    assert cores() >= 1


def taken(queue, now):
    """All processes that have a slot."""
    return list(iter(lambda: queue.next(now), None))


def test_no_more_processes_start_at_once_than_there_are_slots():
    queue = StartQueue(3)
    for name in "abcde":
        queue.add(name)
    assert queue.queued == frozenset("abcde")
    assert taken(queue, 0.0) == ["a", "b", "c"]
    queue.free("b")
    assert taken(queue, 0.1) == ["d"]
    assert queue.queued == {"e"}


def test_a_slow_start_does_not_keep_others_waiting():
    queue = StartQueue(1)
    queue.add("waits for a camera")
    queue.add("b")
    assert taken(queue, 0.0) == ["waits for a camera"]
    assert queue.next_at(0.5) == SLOT_SECONDS
    assert taken(queue, SLOT_SECONDS) == ["b"]
    assert queue.next_at(9.0) is None


def test_a_process_that_is_added_twice_starts_once():
    queue = StartQueue(4)
    queue.add("a")
    queue.add("a")
    assert taken(queue, 0.0) == ["a"]


def test_a_cleared_queue_starts_nothing():
    queue = StartQueue(1)
    queue.add("a")
    queue.clear()
    assert taken(queue, 0.0) == []


@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.sampled_from("abcdefgh"), st.sampled_from(["add", "over"]))),
)
def test_processes_start_in_order_and_never_too_many(at_once, steps):
    queue, running, asked = StartQueue(at_once), set(), []
    for name, step in steps:
        if step == "over" and name in running:
            running.discard(name)
            queue.free(name)
        elif step == "add" and name not in running and name not in asked:
            asked.append(name)
            queue.add(name)
        for turn in taken(queue, 0.0):
            assert turn == asked.pop(0)
            running.add(turn)
        assert len(running) <= at_once
        assert not asked or len(running) == at_once


eStep = EventType("eStep")
eShow = EventType("eShow", visual=True)
SPEC = f"{__name__}:{{}}".format
TEXT = f"""
[world]
scene = "{SPEC("many")}"
vocabulary = "{SPEC("vocabulary")}"
frames = 3

[process.walkers]
agents = ["{SPEC("Walker")}", "{SPEC("Rower")}"]

[process.rocks]
agents = "{SPEC("Rock")}"

[process.steps]
service = "{SPEC("Steps")}"
"""


class Walker(Agent, symbol="AWalker"):
    x: float = 0.0

    @on("eStep")
    def step(self, step, moment):
        self.x += 1.0


class Rower(Agent, symbol="ARower"):
    x: float = 0.0

    @on("eStep", population=True)
    def step(self, step, moment):
        self.x += 1.0


class Rock(Agent, symbol="ARock"):
    """Has no activity."""


class Steps(Generator, events=("eStep",)):
    def generate(self, tick):
        return (eStep(),)


vocabulary = Vocabulary.of(eStep, eShow, Walker, Rower, Rock)
counts = {Walker: 3, Rower: 3, Rock: 1_000_000}


def many(options):
    parts = [cls.many(cls.__name__.lower(), count) for cls, count in counts.items()]
    return parts[0] + parts[1] + parts[2]


def names(tmp_path, old="", new="", **values):
    text = TEXT.replace(old, new) if old else TEXT
    file = read_world_text(text, tmp_path / "w.toml", Overrides(**values))
    assert file.world.expected == {process.name for process in file.processes}
    return [process.name for process in file.processes]


# --- the rule ---


@pytest.mark.parametrize(("work", "most", "hosts"), [
    (0.0, 8, 1), (1.9 * HOST_SECONDS, 8, 1), (2.1 * HOST_SECONDS, 8, 2), (2.1 * HOST_SECONDS, 1, 1),
    (5.9 * HOST_SECONDS, 8, 2), (6.1 * HOST_SECONDS, 8, 3), (1.0, 8, 8), (1.0, 100, 26),
])  # fmt: skip
def test_another_host_starts_if_it_saves_more_than_it_costs(work, most, hosts):
    assert min(hosts_for(work), most) == hosts


# --- in a world file, on a command line, from Python ---

ONE = ["walkers", "rocks", "steps"]
TWO = ["walkers-1", "walkers-2", "rocks", "steps"]
AUTO = ("[process.rocks]", 'processes = "auto"\n[process.rocks]')


@pytest.mark.parametrize(("walkers", "rowers", "cores_here", "expected"), [
    (3, 3, 4, ONE), (round(3 * HOST_SECONDS / AGENT_SECONDS), 3, 4, TWO),
    (3, round(3 * HOST_SECONDS / ROW_SECONDS), 4, TWO), (9_000, 3, 1, ONE),
])  # fmt: skip
def test_agents_get_as_many_hosts_as_they_pay_for(
    tmp_path, monkeypatch, walkers, rowers, cores_here, expected
):
    monkeypatch.setattr(world_files, "cores", lambda: cores_here)
    monkeypatch.setitem(counts, Walker, walkers)
    monkeypatch.setitem(counts, Rower, rowers)
    # Agents without activities take no time, however many they are.
    assert names(tmp_path, processes="auto") == names(tmp_path, *AUTO) == expected
    assert names(tmp_path, *AUTO, processes="1") == ONE
    assert names(tmp_path, processes="2") == [*TWO[:2], "rocks-1", "rocks-2", "steps"]


def test_a_policy_that_makes_copies_has_one_process(tmp_path, monkeypatch):
    monkeypatch.setattr(world_files, "cores", lambda: 4)
    monkeypatch.setitem(counts, Walker, round(3 * HOST_SECONDS / AGENT_SECONDS))
    monkeypatch.setitem(counts, Rock, 1)
    old = '[process.rocks]\nagents = "' + SPEC("Rock") + '"\n'
    literal = 'policy = "literal"\nframes = 3\n'
    text = TEXT.replace(old, "").replace("frames = 3\n", literal)
    file = read_world_text(text, tmp_path / "w.toml", Overrides(processes="auto"))
    assert [each.name for each in file.processes if each.agents] == ["walkers"]


def test_the_choice_is_among_the_notes_of_the_run(tmp_path):
    file = read_world_text(TEXT, tmp_path / "w.toml", Overrides(processes="auto"))
    assert file.notes == ("walkers: 1 process (auto)", "rocks: 1 process (auto)")
    assert not read_world_text(TEXT, tmp_path / "w.toml").notes


SERVICES = f"""[process.steps]
service = "{SPEC("Steps")}"

[process.more]
service = "{SPEC("Steps")}"

[process.stopping]
service = "{SPEC("Steps")}"
on_failure = "stop"

[process.lamp]
service = "{SPEC("Lamp")}"

[process.far]
service = "{SPEC("Steps")}"
elsewhere = true
"""


class Lamp(Device, draws=("eShow",)):
    def show(self, view):
        pass


@pytest.mark.parametrize(("cores_here", "shared"), [(7, ()), (6, ("steps", "more"))])
def test_services_share_a_process_where_there_are_fewer_cores(
    tmp_path, monkeypatch, cores_here, shared
):
    """A process with another policy, and an observer, have their own; one elsewhere needs none."""
    monkeypatch.setattr(world_files, "cores", lambda: cores_here)
    text = TEXT[: TEXT.index("[process.steps]")] + SERVICES
    file = read_world_text(text, tmp_path / "w.toml", Overrides(processes="auto"))
    assert tuple(each.name for each in file.processes if each.shared) == shared
    assert ("services: 1 process for 2 services (auto)" in file.notes) == bool(shared)
    as_it_is = read_world_text(text, tmp_path / "w.toml")
    assert not any(each.shared for each in as_it_is.processes)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("[process.rocks]", 'processes = "many"\n[process.rocks]', 'whole number, or "auto"'),
    ("[process.rocks]", 'processes = 0\n[process.rocks]', 'at least 1, or "auto"'),
    ("[process.steps]", '[process.steps]\nprocesses = "auto"', '"auto" is for agents'),
])  # fmt: skip
def test_other_words_are_refused(tmp_path, old, new, message):
    with pytest.raises(WorldFileError, match=message):
        names(tmp_path, old, new)


def test_a_wrong_option_is_named(tmp_path):
    with pytest.raises(WorldFileError, match="--processes must be at least 1"):
        names(tmp_path, processes="0")


def test_a_world_too_small_for_several_hosts_runs_in_this_process():
    world = World(many({}), agents=[Walker, Rower, Rock], symbols=[eStep], services=[Steps])
    small = request_of(world, {}, processes="auto")
    assert not small.needs_bus(bus=False, processes="auto")
    assert small.needs_bus(bus=True, processes="auto")
    assert request_of(world, {}, processes=1).needs_bus(bus=False, processes=1)
    assert run(world, frames=3, processes="auto").digest == run(world, frames=3).digest


def test_a_large_world_runs_in_several(monkeypatch):
    monkeypatch.setattr(world_files, "cores", lambda: 4)
    world = World(Walker.many("w", 9_000), agents=[Walker], symbols=[eStep], services=[Steps])
    assert request_of(world, {}, processes="auto").needs_bus(bus=False, processes="auto")


def test_a_wrong_number_is_refused():
    world = World(Walker("w").string, agents=[Walker], symbols=[eStep])
    with pytest.raises(MisuseError, match='at least 1, or "auto"'):
        request_of(world, {}, processes=0)
