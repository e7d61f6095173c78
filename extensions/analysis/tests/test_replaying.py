"""Replays show the views of the run, from any start and after any seek."""

from functools import cache

import pytest

from minerva_analysis.replay_algorithm import OVER, ReplayAlgorithm
from minerva_analysis.replays import Rerun, recompute
from minerva_bus import Device
from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.frame.stimuli import Checkpoint
from minerva_bus.launch.past import kinds_in
from minerva_bus.log.record import Cursor
from minerva_bus.runtime.runner import InProcessRunner
from tests.log.recorded_runs import WORLDS, bytes_of, happened, record_of, world_file
from tests.one_process import run_file

mcap = pytest.importorskip("mcap")

SHOWN = {"meadow": "ePicture", "flock": "ePicture", "robot": "eRepresent"}


class Seen(Device, when="each frame"):
    """Stores the digest of each view; it requests one in every frame."""

    def __init__(self, name):
        self.draws = (SHOWN[name],)
        self.shown = []

    def show(self, view):
        self.shown.append((view.frame, view.scene.digest))


@cache
def lived(name):
    """The views of a run, and its digests."""
    world, overrides = WORLDS[name]
    file, seen, digests = world_file(world, **overrides), Seen(name), []
    run_file(file, Member("seen", seen), watch=lambda done, scene: digests.append(scene.digest))
    return seen.shown, digests


def test_a_replay_replaces_only_what_the_algorithm_declares():
    replaced = vars(ReplayAlgorithm).keys() & vars(FrameAlgorithm)
    declared = FrameAlgorithm.__doc__
    assert {name for name in replaced if name[:2] != "__" and f"`{name}`" not in declared} == set()


class Projector:
    """A record that is replayed in this process."""

    def __init__(self, name, folder, begin=0, stay=False, seen=True):
        file, _ = happened(name)
        self.cursor = Cursor(record_of(bytes_of(name), folder))
        scene = self.cursor.seek(begin)
        recorded = self.cursor._record.description.world
        world = type(recorded)(
            recorded.name, scene, recorded.vocabulary, recorded.seed, recorded.dt, recorded.order, recorded.policy,
            expected=frozenset(["seen"] if seen else []), past=Checkpoint(begin),
        )  # fmt: skip
        self.algorithm = ReplayAlgorithm(world, self.cursor, kinds_in(file), stay=stay)
        self.told, self.seen = [], Seen(name)
        members = [Member("seen", self.seen)] if seen else []
        self.runner = InProcessRunner(self.algorithm, members, self.told.append)
        self.runner.start()
        if not seen:
            self.runner.handle(s.Begin())  # Without members this only starts the world.

    def play(self, frames=1000):
        for _ in range(frames):
            if self.runner.ended is None and self.cursor.ahead is not None:
                self.runner.handle(s.Begin())

    @property
    def digests(self):
        return [message.record.digest for message in self.told if isinstance(message, s.FrameDone)]


@pytest.mark.parametrize("name", WORLDS)
def test_its_views_and_strings_are_those_of_the_run(name, tmp_path):
    projector, (shown, digests) = Projector(name, tmp_path), lived(name)
    played = []
    while projector.runner.ended is None:
        projector.runner.handle(s.Begin())
        played.append(projector.algorithm.scene.digest)
    assert projector.seen.shown == shown
    assert played == digests
    assert projector.runner.ended.reason == OVER


@pytest.mark.parametrize("name", WORLDS)
def test_it_may_begin_in_the_middle(name, tmp_path):
    projector, (shown, _) = Projector(name, tmp_path, begin=7), lived(name)
    projector.play()
    assert projector.seen.shown == [item for item in shown if item[0] >= 7]


@pytest.mark.parametrize("name", WORLDS)
def test_it_is_wound_to_any_frame_and_shows_it_at_once(name, tmp_path):
    projector, (shown, digests) = Projector(name, tmp_path, stay=True), lived(name)
    by_frame = dict(shown)
    projector.play()
    assert projector.runner.ended is None
    assert projector.algorithm.scene.digest == digests[-1]
    for frame in (3, 10, 0, 8):
        projector.seen.shown.clear()
        projector.runner.handle(s.Seek(frame))
        projector.play(2)
        assert projector.seen.shown[0] == (frame, by_frame[frame])
        assert projector.seen.shown[1:] == [(n, by_frame[n]) for n in (frame, frame + 1)]
        assert projector.algorithm.scene.digest == digests[frame + 1]
    projector.seen.shown.clear()
    projector.runner.handle(s.Seek(projector.cursor.end))
    assert projector.seen.shown == [(projector.cursor.end, by_frame[projector.cursor.end])]


def test_to_wind_it_to_its_end_is_to_end_it(tmp_path):
    projector = Projector("meadow", tmp_path)
    projector.play(2)
    projector.runner.handle(s.Seek(projector.cursor.end))
    assert projector.runner.ended.reason == OVER


def test_there_is_nothing_beyond_its_end(tmp_path):
    projector = Projector("meadow", tmp_path)
    with pytest.raises(MinervaError, match="the string of frame 61 is not in the record"):
        projector.cursor.seek(61)


def test_a_device_that_joins_at_rest_receives_the_view(tmp_path):
    projector = Projector("meadow", tmp_path, seen=False)
    projector.play(5)
    seen = Seen("meadow")
    projector.runner.direct.add(Member("late", seen))
    projector.runner.handle(s.Appeared("late"))
    assert seen.shown == [(5, dict(lived("meadow")[0])[5])]


def test_it_rests_while_an_observer_is_present(tmp_path):
    projector = Projector("meadow", tmp_path, stay=True)
    projector.play()
    assert projector.runner.ended is None
    assert not projector.algorithm.waiting_for()
    projector.runner.handle(m.Leaving("seen"))
    assert projector.runner.ended.reason == OVER


def test_it_does_not_rest_without_observers(tmp_path):
    projector = Projector("meadow", tmp_path, stay=True, seen=False)
    projector.play()
    assert projector.runner.ended.reason == OVER


class Film(Seen, coupled=True):
    """Receives each view, as a film does."""


def test_it_waits_until_a_coupled_device_has_shown_its_view(tmp_path):
    """Otherwise a fast replay is over long before the film of it, whose process is then killed."""
    projector = Projector("meadow", tmp_path, seen=False)
    algorithm, film = projector.algorithm, Member("film", Film("meadow"))
    for stimulus in (s.Appeared("film"), film.hello()):
        algorithm.receive(stimulus)
    for frame in (0, 1):
        algorithm.receive(s.Begin())
        assert (algorithm.frame, algorithm.waiting_for()) == (frame, ["film"])
        algorithm.receive(m.TickReply("film", frame - 1))
        assert (algorithm.frame, algorithm.waiting_for()) == (frame, ["film"])
        algorithm.receive(m.TickReply("film", frame))
        assert (algorithm.frame, algorithm.waiting_for()) == (frame + 1, [])
    algorithm.receive(s.Begin())
    algorithm.receive(s.Vanished("film"))
    assert (algorithm.frame, algorithm.waiting_for()) == (3, [])


def test_it_takes_no_orders(tmp_path):
    projector = Projector("meadow", tmp_path)
    vocabulary = projector.algorithm.world.vocabulary
    projector.runner.handle(s.Publish(vocabulary.events["eStep"]()))
    assert not projector.algorithm.inbox.events


# --- λ recomputed ---


@pytest.mark.parametrize("name", WORLDS)
def test_all_frames_are_reconstructed(name, tmp_path):
    file, frames = happened(name)
    lines = []
    with record_of(bytes_of(name), tmp_path) as record:
        result = recompute(record, kinds_in(file), lines.append)
    assert (result.same, result.frames) == (True, len(frames))
    assert lines == list(range(1, len(frames) + 1))


def test_the_first_frame_that_differs_is_named_and_what_differs(tmp_path, monkeypatch):
    file, _ = happened("meadow")
    run = bytes_of("meadow")  # before its code changes
    kinds = kinds_in(file)
    rabbit = kinds["ARabbit"]
    activity = rabbit.activities["eStep"]

    def steps(self, event, moment):
        result = activity(self, event, moment)
        if moment.number == 4 and self.id == "r2":
            self.x += 1
        return result

    monkeypatch.setitem(rabbit.activities, "eStep", steps)
    with record_of(run, tmp_path) as record:
        result = recompute(record, kinds, lambda _: None)
    assert result.frame == 4
    lines = "\n".join(result.lines())
    assert "frame 4 is the first that differs" in lines
    assert "ARabbit#r2" in lines
    assert " in the record, " in lines
    assert " in this run" in lines


def _first_sending(record):
    """The first frame in which agents sent events."""
    cursor = Cursor(record, state=True)
    while not (cursor.checkpoint and cursor.checkpoint.emitted):
        cursor.advance()
    return cursor.number - 1


def test_events_that_agents_send_no_more_are_a_difference(tmp_path, monkeypatch):
    file, frames = happened("meadow")
    kinds = kinds_in(file)
    sends = {event.type for record, _ in frames for event in record.events if event.sender}
    with record_of(bytes_of("meadow"), tmp_path) as record:
        first = _first_sending(record)
        monkeypatch.setattr("minerva_bus.world.context.Context.emit", lambda *_, **__: None)
        result = recompute(record, kinds, lambda _: None)
    assert sends
    assert result.frame == first
    assert result.only_a
    assert "events of the record alone:" in result.lines()[1]


def test_a_missing_frame_ends_a_rerun(tmp_path):
    file, _ = happened("meadow")
    with record_of(bytes_of("meadow"), tmp_path) as record:
        algorithm = FrameAlgorithm(file.world)
        rerun = Rerun(record, algorithm)
        runner = InProcessRunner(algorithm, [process.make_member() for process in file.processes])
        runner.start()
        algorithm.now.frame = 3
        with pytest.raises(Exception, match="frame 3 is not in the record, so the run cannot"):
            rerun.step(runner)
