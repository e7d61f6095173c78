"""Values of a running world, from its journal and its record: as few frames as needed repeat."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from minerva_analysis import explaining as journaled_past
from minerva_analysis.explaining import explain_running_value
from minerva_bus.errors import RecordError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.run_outputs import description_of
from minerva_bus.log import journal
from minerva_bus.log.entries import Kept, encode_header
from minerva_bus.log.journal import Journal, read_described
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.runtime.runner import InProcessRunner
from tests.log.harbour import harbour

FRAMES = 60
EVERY = 8


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """A world after 60 frames: a journal with keyframes, and its record up to frame 40."""
    folder = tmp_path_factory.mktemp("running")
    file = harbour().read()
    algorithm = FrameAlgorithm(file.world)
    with pytest.MonkeyPatch.context() as patch, (folder / "r.mcap").open("wb") as stream:
        patch.setattr(journal, "KEY_FRAMES", EVERY)
        patch.setattr(journal, "KEY_RATIO", 0)
        description = description_of(file)
        written = Journal(
            folder / "w.journal", 1, algorithm, encode_header(description, string=False)
        )
        record = RecordWriter(stream, description)

        def watch(done):
            if isinstance(done, s.FrameDone):
                written.frame(done.inputs)
                if written.is_keyframe_due:
                    written.add_keyframe()
                if done.frame < 40:
                    record.frame(done, algorithm.scene, 0.0, {}, Kept.of(algorithm.checkpoint))

        members = [process.make_member() for process in file.processes]
        runner = InProcessRunner(algorithm, members, watch)
        runner.start()
        for _ in range(FRAMES):
            runner.handle(s.Begin())
        record.finish()
        written.close(over=False)
    return folder


def operator_of(folder, *names):
    known = {"journal": folder / "w.journal", "record": folder / "r.mcap"}
    files = tuple(SimpleNamespace(name=name, path=str(known[name])) for name in names)
    status = SimpleNamespace(frame=FRAMES, files=files, world="harbour")
    return SimpleNamespace(status=lambda: status)


@pytest.fixture
def repeated(monkeypatch):
    """The frames from which the journal was repeated."""
    begins, recent = [], journaled_past.recent_record

    def counted(path, folder, begin=0):
        begins.append(begin)
        return recent(path, folder, begin)

    monkeypatch.setattr(journaled_past, "recent_record", counted)
    return begins


def explained(folder, agent, attribute, frame=None, files=("journal",)):
    return explain_running_value(
        operator_of(folder, *files), harbour().read, agent, attribute, frame
    )


@pytest.mark.parametrize("frame", [None, 52, 47, 9])
@pytest.mark.parametrize(
    ("agent", "attribute"), [("port", "answers"), ("pilot", "calls"), ("c1", "below"), ("s1", "tons")]
)  # fmt: skip
def test_an_explanation_is_that_of_the_whole_journal(running, monkeypatch, agent, attribute, frame):
    answer = explained(running, agent, attribute, frame)
    monkeypatch.setattr(journaled_past, "starts_before", lambda keyframes, frame: [0])
    whole = explained(running, agent, attribute, frame)
    assert replace(answer, first=0) == whole


def test_only_frames_after_the_last_keyframe_are_repeated_for_a_new_value(running, repeated):
    assert explained(running, "port", "answers").since == 57
    assert repeated == [48]


def test_without_a_record_an_old_value_is_searched_in_twice_as_many_frames_each_time(
    running, repeated
):
    assert explained(running, "c1", "below").since == 9
    assert repeated == [48, 40, 24, 0]


def test_an_old_value_is_explained_by_the_record_as_soon_as_it_has_the_frames(running, repeated):
    answer = explained(running, "c1", "below", files=("journal", "record"))
    assert repeated == [48, 40]
    assert answer == explained(running, "c1", "below")


def test_a_frame_that_the_record_has_is_not_repeated(running, repeated):
    answer = explained(running, "pilot", "calls", 38, ("journal", "record"))
    assert repeated == []
    assert answer == replace(explained(running, "pilot", "calls", 38), first=0)
    assert repeated == [24]


def test_a_missing_agent_or_attribute_is_named(running):
    with pytest.raises(RecordError, match="no agent #s9; there are port"):
        explained(running, "s9", "x")
    with pytest.raises(RecordError, match="no attribute 'tonns'; did you mean 'tons'"):
        explained(running, "s1", "tonns")


def test_a_successor_reads_all_frames(running):
    _, journaled = read_described(running / "w.journal")
    assert (journaled.keyframe.number, len(journaled.inputs)) == (0, FRAMES)
    _, journaled = read_described(running / "w.journal", 30)
    assert (journaled.keyframe.number, len(journaled.inputs)) == (24, FRAMES - 24)
