"""Playback of recordings: due times, offsets, loops, and progress despite bad stamps."""

import math
import os
import threading
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded import Hurried

from minerva_bus.errors import MisuseError
from minerva_bus.launch.specs import described
from minerva_bus.log.recordings import Recorded, RecordingError
from minerva_bus.world.readings import Battery, Mount
from minerva_services.bridging import SourceError
from minerva_services.sensors.playback import (
    MAX_GAP_SECONDS,
    MountOverride,
    PlaybackPace,
    Player,
    Playing,
    due_times,
)

STAMPS = st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=40)


class Tape:
    """A recording of battery readings with the given stamps."""

    part = 0.0

    def __init__(self, *stamps, breaks=False):
        self.stamps, self.breaks, self.closed = stamps, breaks, False

    def readings(self):
        for stamp in self.stamps:
            yield Recorded(stamp, "battery", Battery("r1", 1.0, 12.0, stamp))
        if self.breaks:
            raise RecordingError("the tape is torn")

    def close(self):
        self.closed = True


class Deck(Playing, when="freely"):
    publishes = ("battery",)

    def __init__(self, file: str, tape, pace=None):
        super().__init__(file, pace or PlaybackPace(0.0))
        self.tape = tape

    def recording(self):
        return self.tape


class Heard:
    """Collects the readings of a bridge and stops it after `most`."""

    def __init__(self, most=100):
        self.times, self.stop, self.most = [], threading.Event(), most

    def publish(self, topic, reading):
        assert topic == "battery"
        self.times.append(reading.time)
        if len(self.times) >= self.most:
            self.stop.set()


def played(tape, pace, most=100):
    stop, times = threading.Event(), []
    for _, reading in Player(tape, pace).read(stop):
        times.append(reading.time)
        if len(times) >= most:
            stop.set()
    return times


@pytest.mark.parametrize(
    ("stamps", "speed", "due"),
    [
        ([10.0, 10.5, 12.0], 1.0, [0.0, 0.5, 2.0]),
        ([10.0, 10.5, 12.0], 4.0, [0.0, 0.125, 0.5]),
        ([10.0, 10.5, 12.0], 0.0, [0.0, 0.0, 0.0]),
        ([1.0, 2.0, 1.5, 2.25], 1.0, [0.0, 1.0, 1.0, 1.25]),
        ([1.0, 2.0, 1000.0, 1001.0], 1.0, [0.0, 1.0, 1.0 + MAX_GAP_SECONDS, 2.0 + MAX_GAP_SECONDS]),
        ([100.0, 101.0, 1.0, 2.0], 1.0, [0.0, 1.0, 1.0, 2.0]),
        ([10.0, 12.0, 10.5, 11.0], 1.0, [0.0, 2.0, 2.0, 2.5]),
        ([10.0, 12.0, 0.0, 12.5, 13.0], 1.0, [0.0, 2.0, 2.0, 2.5, 3.0]),
        ([1.0, math.nan, 2.0, math.inf, 3.0], 1.0, [0.0, 0.0, 1.0, 1.0, 2.0]),
        ([], 1.0, []),
    ],
)
def test_when_readings_are_due(stamps, speed, due):
    assert list(due_times(stamps, speed)) == pytest.approx(due)


@given(STAMPS, st.floats(0.01, 100))
def test_playback_is_never_early_and_never_stalls(stamps, speed):
    due = list(due_times(stamps, speed))
    assert len(due) == len(stamps)
    steps = [after - before for before, after in pairwise([0.0, *due])]
    assert all(0 <= step <= MAX_GAP_SECONDS / speed * 1.0001 + 1e-9 for step in steps)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=40))
def test_a_clock_that_goes_well_is_followed(steps):
    stamps = [sum(steps[:i]) for i in range(len(steps))]
    assert list(due_times(stamps, 2.0)) == pytest.approx([stamp / 2 for stamp in stamps])


def test_as_fast_as_it_goes_all_are_played_in_their_order():
    assert played(Tape(3.0, 1.0, 1e9, 2.0), PlaybackPace(0.0)) == [3.0, 1.0, 1e9, 2.0]


def test_from_an_offset_on():
    assert played(Tape(5.0, 6.0, 7.0, 4.0), PlaybackPace(0.0, offset=1.5)) == [7.0, 4.0]
    assert played(Tape(105.0, 106.0, 5.0, 6.0), PlaybackPace(0.0, offset=1.5)) == [6.0]


def test_again_from_its_beginning():
    assert played(Tape(1.0, 2.0), PlaybackPace(0.0, loop=True), most=5) == [1.0, 2.0, 1.0, 2.0, 1.0]


@pytest.mark.parametrize(
    ("stamps", "speed", "gap"),
    [((1.0,), 1.0, 0.1), ((1.0, 1.0), 2.0, 0.05), ((0.0, 1.0, 3.0), 1.0, 4.5)],
)
def test_rounds_are_as_far_apart_as_readings(stamps, speed, gap):
    stop = Hurried(3)
    heard = list(Player(Tape(*stamps), PlaybackPace(speed, loop=True)).read(stop))
    assert any(asked == pytest.approx(gap, abs=0.02) for asked in stop.asked)
    assert len(heard) <= 3 * len(stamps)


def test_an_offset_beyond_the_end_is_reported_once():
    with pytest.raises(SourceError, match="nothing to play after 9 s"):
        played(Tape(1.0, 2.0), PlaybackPace(0.0, loop=True, offset=9.0))


def test_waiting_for_a_due_reading_can_be_stopped():
    stop, times = threading.Event(), []
    for _, reading in Player(Tape(0.0, 4.0), PlaybackPace(0.001)).read(stop):
        times.append(reading.time)
        threading.Timer(0.02, stop.set).start()
    assert times == [0.0]


@pytest.mark.parametrize("options", [{"speed": -1.0}, {"speed": math.nan}, {"offset": -0.1}])
def test_wrong_paces(options):
    with pytest.raises(MisuseError, match=r"expected a number from 0"):
        PlaybackPace(**options)


def test_a_mount_overrides_what_was_recorded_part_by_part():
    recorded = Mount(1.0, 2.0, 90.0)
    assert MountOverride().over(recorded) == recorded
    assert MountOverride(mount_y=0, mount_angle=45.0).over(recorded) == Mount(1.0, 0.0, 45.0)


@pytest.mark.parametrize("wrong", ["left", math.inf, True])
def test_a_wrong_mount(wrong):
    with pytest.raises(MisuseError, match="mount_x is"):
        MountOverride(mount_x=wrong)


def test_a_bridge_plays_counts_and_ends(tmp_path, capsys):
    tape, heard = Tape(1.0, 2.0, 3.0), Heard()
    deck = Deck(str(tmp_path), tape)
    deck.run(heard, heard.stop)
    assert heard.times == [1.0, 2.0, 3.0]
    assert deck.report() == {"readings": 3, "source": "ended"}
    assert tape.closed
    assert capsys.readouterr().out == f"{tmp_path} has ended\n"


def test_a_recording_that_cannot_be_read_is_one_line_and_seen(tmp_path, capsys):
    deck, heard = Deck(str(tmp_path), Tape(1.0, breaks=True)), Heard()
    deck.run(heard, heard.stop)
    assert capsys.readouterr().out == "the tape is torn\n"
    assert deck.report() == {"readings": 1, "failures": 1, "source": "the tape is torn"}


def test_skipped_messages_are_reported_once_and_counted(tmp_path, capsys):
    deck = Deck(str(tmp_path), Tape(1.0))
    for number in range(3):
        deck.pass_over("lines passed over", f"line {number} skipped")
    assert deck.report()["lines passed over"] == 3
    assert capsys.readouterr().out.splitlines() == [
        "line 0 skipped; further ones are counted as 'lines passed over'"
    ]


def test_a_missing_file_is_reported_at_once():
    with pytest.raises(MisuseError, match=r"file 'nothing.log' does not exist"):
        Deck("nothing.log", Tape())


def test_a_pipe_is_no_recording(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(MisuseError, match="pipe' is a pipe or device; expected a recording"):
        Deck(str(tmp_path / "pipe"), Tape())


@pytest.mark.parametrize("name", ["rosbag", "carmen", "csv", "ros2", "ros2_robot", "mqtt"])
def test_options_of_groups_have_a_description(name):
    bare = [option for option, text in described(name) if text.lstrip().startswith("[")]
    assert bare == []
