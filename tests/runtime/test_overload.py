"""Overload: memory is bounded, a log line reports it, and the string is the same."""

import os
import re
import signal
from pathlib import Path

from running import MEMBERS, STRING, World, alone, eventually, write_world

FLOOD = (
    MEMBERS
    + """
[process.flood]
service = "yard:Flood"
count = {count}
"""
)


def resident(pid):
    """Resident memory of a process in megabytes."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def test_ten_thousand_events_in_a_frame(tmp_path):
    path = write_world(tmp_path, FLOOD.format(count=10_000), frames=6)
    with World(path, "--json") as world:
        assert world.summary()["digest"] == alone(path)["digest"]


def test_a_fragment_of_ten_megabytes(tmp_path):
    text = "x" * 10_000_000
    string = f'{STRING} · AWalker#big<x=9, wish="{text}">'
    path = write_world(tmp_path, frames=5, string=string)
    with World(path, "--json") as world:
        assert world.summary()["digest"] == alone(path)["digest"]


def test_one_that_publishes_faster_than_the_world_consumes(tmp_path):
    """A paused world queues a limited number of its events, drops and counts the rest."""
    members = MEMBERS + '\n[process.torrent]\nservice = "yard:Torrent"\n'
    path = write_world(tmp_path, members, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers", "torrent")
        with world.client() as asked:
            asked.operator.pause()
            said = world.says(
                "torrent │ event queue full: 100000 events wait for a frame; dropping further events"
            )
            assert said
            coordinator = world.coordinator()
            before = resident(coordinator)

            def dropped():
                member = next(m for m in asked.operator.status().members if m.name == "torrent")
                return dict(member.figures).get("dropped", 0)

            first = eventually(dropped, "what is dropped is counted")
            eventually(lambda: dropped() > first + 100_000, "more is dropped")
            assert resident(coordinator) < before + 100
            asked.operator.resume()
            frame = asked.operator.status().frame
            eventually(lambda: asked.operator.status().frame > frame, "the world goes on")
        world.kill(signal.SIGINT)
        world.ends()
        world.gone()
    assert len(re.findall("dropping further events", world.text)) == 1
