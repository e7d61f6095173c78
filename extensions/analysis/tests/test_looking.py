"""One frame of a record as text: `minerva info FILE --frame N`, `--string`."""

import json

import pytest

from minerva_analysis.frame_texts import frames_up_to
from minerva_bus.grammar.events import single
from tests.log.recorded_runs import bytes_of, happened, strings_of
from tests.runtime.running import here

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")


@pytest.fixture
def info(tmp_path):
    def told(world, *words):
        (tmp_path / "run.mcap").write_bytes(bytes_of(world))
        done = here(tmp_path, "info", "run.mcap", *words)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return told


@pytest.mark.parametrize("name", ["meadow", "flock", "robot"])
@pytest.mark.parametrize("number", [0, 7, None])
def test_the_string_of_a_frame_is_read_back(name, number, info):
    words = ("--string",) if number is None else ("--frame", number, "--string")
    printed = info(name, *words)
    string = strings_of(name)[-1 if number is None else number]
    assert happened(name)[0].world.vocabulary.read(printed, "info") == string
    assert len(printed.splitlines()) == len(string)


def test_a_frame_is_shown_with_its_events(info):
    shown = info("meadow", "--frame", 7).splitlines()
    assert shown[0] == "frame 7, 0.28 s of the world: 3 AFox, 1 AMeadow, 6 ARabbit"
    assert shown[1] == f"  digest  {strings_of('meadow')[7].digest.hex()}"
    record, _ = happened("meadow")[1][7]
    assert [line.strip() for line in shown[3:]] == [str(event) for event in single(record.events)]


def test_the_end_is_shown(info):
    assert info("meadow", "--frame", 60).splitlines()[2] == "  the record ends here"


def test_a_frame_as_json(info):
    answer = json.loads(info("meadow", "--frame", 3, "--json"))
    string = strings_of("meadow")[3]
    assert (answer["frame"], answer["string"]) == (3, str(string))
    assert answer["digest"] == string.digest.hex()
    assert len(answer["events"]) == sum(1 for _ in single(happened("meadow")[1][3][0].events))


@pytest.mark.parametrize("number", [61, -1])
def test_a_frame_that_is_not_there(number, tmp_path):
    (tmp_path / "run.mcap").write_bytes(bytes_of("meadow"))
    done = here(tmp_path, "info", "run.mcap", "--frame", number)
    assert done.returncode == 2
    assert done.stderr == f"minerva: run.mcap: it has frames 0 to 59, not {number}\n"


@pytest.mark.parametrize(
    ("end", "text"),
    [(0, "no frames"), (1, "frame 0 only"), (2, "frames 0 to 1"), (60, "frames 0 to 59")],
)
def test_the_frames_of_a_record(end, text):
    assert frames_up_to(end) == text
