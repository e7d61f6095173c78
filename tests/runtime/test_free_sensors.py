"""Free-running sensors: readings arrive at most once, as requested; drops are counted."""

import threading
from contextlib import suppress

import numpy as np
import pytest
from running import World, eventually, write_world

from minerva_bus import Generator
from minerva_bus.errors import MisuseError
from minerva_bus.frame.member_side import MAX_READINGS, Member, ReadingBuffer
from minerva_bus.frame.messages import Readings
from minerva_bus.launch.in_process import MAX_WAITING, WaitingOutput
from minerva_bus.runtime.participants import Outlet, OwnThreads
from minerva_bus.runtime.session import REAL
from minerva_bus.wire.field_codecs import plain_reading, read_reading
from minerva_bus.world.readings import Battery, Image, Mount, Odometry, Position, Scan
from tests.patience import patience

BATTERIES = [Battery("r", charge / 10, 12.0, 0.0) for charge in range(10)]


def anyone(_):
    return True


def free(*readings, member="m"):
    return Readings(member, "battery", -1, readings)


def test_the_newest_counts_once_and_the_others_are_counted():
    intake = ReadingBuffer()
    for battery in BATTERIES[:3]:
        intake.put(free(battery))
    assert intake.taken(0, anyone) == (BATTERIES[2],)
    assert intake.taken(0, anyone) == ()
    assert intake.dropped == 2


def test_all_count_in_their_order():
    intake = ReadingBuffer("all")
    intake.put(free(*BATTERIES[:2], member="b"))
    intake.put(free(BATTERIES[5], member="a"))
    intake.put(free(BATTERIES[2], member="b"))
    assert intake.taken(0, anyone) == (BATTERIES[5], *BATTERIES[:3])
    assert intake.dropped == 0


def test_every_nth_counts():
    intake = ReadingBuffer("all", nth=3)
    intake.put(free(*BATTERIES))
    assert intake.taken(0, anyone) == (BATTERIES[2], BATTERIES[5], BATTERIES[8])
    assert intake.dropped == 7


def test_waiting_items_are_bounded():
    intake = ReadingBuffer("all")
    for _ in range(MAX_READINGS + 5):
        intake.put(free(BATTERIES[0]))
    assert len(intake.taken(0, anyone)) == MAX_READINGS
    assert intake.dropped == 5


def test_readings_in_step_count_only_in_the_tick_of_their_frame():
    buffer = ReadingBuffer()

    def put(member, frame):
        buffer.put(Readings(member, "battery", frame, (BATTERIES[frame],)))

    put("leaves", 3)
    put("stays", 3)
    assert buffer.taken(3, anyone) == (BATTERIES[3], BATTERIES[3])
    put("leaves", 3)  # Repeated for a newcomer, then its publisher leaves.
    put("stays", 4)
    assert buffer.taken(4, anyone) == (BATTERIES[4],)
    put("stays", 6)  # For a later frame than the one that is asked.
    assert buffer.taken(5, anyone) == ()
    assert buffer.taken(6, anyone) == (BATTERIES[6],)


@pytest.mark.parametrize(
    "reading",
    [
        Image("r", b"\xff\xd8", "jpeg", 640, 480, 1.5, Mount(0.1, 0.0, 90.0)),
        Image("r", bytes(12), "rgb8", 2, 2, 1.5),
        Odometry("r", 1.0, 2.0, 90.0, 0.5, 10.0, 3.0),
        Battery("r", 0.5, 12.1, 0.25),
        Position("r", 52.5, 13.4, 34.0, 2.5, 9.0),
        Position("r", 52.5, 13.4, None, None, 9.0),
    ],
)
def test_readings_travel(reading):
    assert read_reading(plain_reading(reading)) == reading


def test_a_scan_travels():
    scan = Scan("r", np.array([1.0, 2.0], np.float32), -90.0, 1.0, 8.0, 0.5, 0.1, 0.2, 90.0)
    again = read_reading(plain_reading(scan))
    assert again.ranges.tolist() == [1.0, 2.0]
    assert plain_reading(again) == plain_reading(scan)


MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"

[process.gauge]
service = "yard:Gauge"

[process.reader]
service = "yard:Reader"
takes = "all"

[process.newest]
service = "yard:Reader"
"""


def test_readings_of_a_free_sensor_count_and_drops_are_reported(tmp_path):
    with (
        World(write_world(tmp_path, MEMBERS, frames=0, rate=10)) as world,
        world.client() as asked,
    ):
        world.runs("gauge", "reader", "newest")

        def figures():
            members = {member.name: member.figures for member in asked.operator.status().members}
            reader, newest = members["reader"], members["newest"]
            enough = reader.get("read", 0) > 30 and newest.get("dropped", 0) > 0
            return (reader, newest) if enough else None

        reader, newest = eventually(figures, "readings are read, and counted")
        assert "dropped" not in reader
        assert reader["in order"]
        assert newest["read"] < reader["read"]


class Careless(Generator, when="freely"):
    """Publishes until it is stopped, and ignores every exception."""

    def run(self, emit, stop):
        while not stop.is_set():
            with suppress(Exception):
                emit.publish("battery", BATTERIES[0])


def test_output_that_cannot_be_sent_is_an_error_although_the_generator_ignores_exceptions():
    items = []

    def send(output):
        raise MisuseError(f"wrong: {output.topic}")

    threads = OwnThreads("careless", items.append, send, print, REAL, ends=False)
    threads.start(Member("careless", Careless()))
    eventually(lambda: items, "the error is in the inbox of the main thread")
    threads.stop()
    assert str(items[0]) == "wrong: battery"


class Kept(Generator, when="freely"):
    """Keeps its outlet."""

    def run(self, emit, stop):
        self.emit = emit


def test_nothing_is_sent_after_the_end():
    sent, kept = [], Kept()
    threads = OwnThreads("kept", print, sent.append, print, REAL, ends=False)
    threads.start(Member("kept", kept))
    eventually(lambda: hasattr(kept, "emit"), "it runs")
    kept.emit.publish("battery", BATTERIES[0])
    threads.stop()
    kept.emit.publish("battery", BATTERIES[1])
    assert [output.reading for output in sent] == [BATTERIES[0]]


def test_a_publisher_faster_than_the_frames_waits_and_is_released_at_the_end():
    said, stop = [], threading.Event()
    waiting = WaitingOutput(said.append, stop)
    outlet = Outlet(waiting.add)

    def chatter():
        while not stop.is_set():
            outlet.publish("battery", BATTERIES[0])

    thread = threading.Thread(target=chatter, daemon=True)
    thread.start()
    eventually(lambda: len(said) == MAX_WAITING, "as many as may wait")
    waiting.taken()
    eventually(lambda: len(said) == MAX_WAITING + 1, "one more")
    stop.set()
    thread.join(patience(10))
    assert not thread.is_alive()
    assert len(said) == MAX_WAITING + 1
