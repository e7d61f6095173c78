"""The cursor restores the state before any frame, and its inputs lead to the next frames."""

from dataclasses import replace

import pytest

from minerva_bus.log.record import Cursor
from tests.log.recorded_runs import CHECKPOINTS, bytes_of, happened, record_of, strings_of
from tests.one_process import run_world

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")


@pytest.mark.parametrize("name", ["meadow", "robot"])
def test_the_state_before_each_frame_is_that_of_the_run(name, tmp_path):
    strings = strings_of(name)
    with record_of(bytes_of(name), tmp_path) as record:
        cursor = Cursor(record, state=True)
        for number, kept in enumerate(CHECKPOINTS[name, None], 1):
            assert cursor.advance() == strings[number]
            assert cursor.number == number
            assert replace(cursor.checkpoint, saved={}) == kept.checkpoint
            assert cursor.checkpoint.saved.keys() == kept.saved.keys()
        assert cursor.ahead is None
        cursor.seek(7)
        assert cursor.scene == strings[7]
        assert cursor.ahead.number == 7


def test_the_last_events_before_a_frame_may_be_far_before_it(tmp_path):
    with record_of(bytes_of("meadow"), tmp_path) as record:
        frames = list(record.frames())
        for before in (0, 9, 60):
            known = [frame for frame in frames if frame.number < before]
            last = {
                event.type: (each.number, each.events) for each in known for event in each.events
            }
            assert record.last_events(record.description.world.vocabulary.events, before) == last
            for name, expected in last.items():
                assert record.last_events([name], before) == {name: expected}
            assert before < 60 or min(number for number, _ in last.values()) < 50


def futures(record, number, file, seed):
    """The digests of a run that starts from the state before a frame of a record."""
    cursor = Cursor(record, state=True)
    scene = cursor.seek(number)
    world = replace(file.world, scene=scene, past=cursor.checkpoint, seed=seed)
    members, digests = [process.make_member() for process in file.processes], []
    run_world(world, members, lambda done, scene: digests.append(scene.digest))
    return digests


def test_a_run_has_more_than_one_future(tmp_path):
    file, frames = happened("meadow")
    with record_of(bytes_of("meadow"), tmp_path) as record:
        digests = [frame.digest for frame, _ in frames[20:]]
        assert futures(record, 20, file, file.world.seed) == digests
        assert futures(record, 20, file, file.world.seed + 1) != digests
        assert futures(record, 20, file, file.world.seed) == digests
