"""Data sets of LeRobot made of records, read with pyarrow, and with lerobot's reader if there."""

import io
import json

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pip install 'minerva-bus[lerobot]'")
import pyarrow.parquet as pq
from PIL import Image as Pillow

from minerva_bus import MinervaError
from minerva_bus.cli.main import app
from minerva_bus.log.record import Record
from minerva_exporters import export_dataset
from minerva_exporters.sources import RecordFrames
from tests.services.rover_yard import readings, record_yard

STATE = ["x", "y", "angle", "gear=low", "gear=high", "moves"]


@pytest.fixture(scope="module")
def dataset(recorded, tmp_path_factory):
    """A data set of two records of the yard, with another seed in the second one."""
    folder = tmp_path_factory.mktemp("lerobot")
    record_yard(folder / "other.mcap", seed=7)
    records = [recorded[1], folder / "other.mcap"]
    done = export_dataset(records, folder / "set", "lerobot", act=["eSteer"])
    assert done.counts == {"episodes": 4, "frames": 20}
    return folder / "set", records


def rows_of(path):
    return pq.read_table(path).to_pylist()


def test_rows_are_the_strings_and_the_events_of_the_records(dataset):
    path, records = dataset
    for number, record in enumerate(records):
        with Record(record) as opened:
            frames = list(RecordFrames(opened))[:-1]
        for at, agent in enumerate(("r1", "r2")):
            index = 2 * number + at
            rows = rows_of(path / f"data/chunk-000/file-{index:03d}.parquet")
            assert [row["index"] for row in rows] == list(range(5 * index, 5 * index + 5))
            assert {row["episode_index"] for row in rows} == {index}
            for row, frame in zip(rows, frames, strict=True):
                state = next(node.state for node in frame.scene if node.id == agent)
                gear = [state["gear"] == word for word in ("low", "high")]
                expected = [state["x"], state["y"], state["angle"], *gear, state["moves"]]
                assert row["observation.state"] == np.float32(expected).tolist()
                steered = [e for e in frame.events if agent in e.receivers]
                action = [steered[0].ahead, steered[0].turn] if steered else [0.0, 0.0]
                assert row["action"] == np.float32(action).tolist()
                assert row["timestamp"] == pytest.approx(frame.number * 0.1)
    assert {row["action"][0] == 0.0 for row in rows_of(path / "data/chunk-000/file-000.parquet")} \
        == {True, False}  # fmt: skip


def test_readings_are_the_latest_ones_of_the_agent(dataset):
    path, _ = dataset
    robot, other = (rows_of(path / f"data/chunk-000/file-00{n}.parquet") for n in (0, 1))
    assert robot[0]["observation.scan"] == [0.0] * 4
    # A beam without a hit has the maximum range, one without a measurement 0.
    assert robot[2]["observation.scan"] == [3.5, 8.0, 0.0, 0.75]
    assert robot[2]["observation.odometry"] == [3.0, 2.0, 90.0, 0.5, 10.0]
    black, seen = (robot[n]["observation.images.image"]["bytes"] for n in (0, 2))
    pixels = dict(readings(2, 0.2))["image"].data
    assert not np.asarray(Pillow.open(io.BytesIO(black))).any()
    assert np.asarray(Pillow.open(io.BytesIO(seen))).tobytes() == pixels
    photo = dict(readings(2, 0.2))["photo"].data
    assert robot[2]["observation.images.photo"]["bytes"] == photo
    assert all(row["observation.scan"] == [0.0] * 4 for row in other)


def test_the_metadata_describe_the_data(dataset):
    path, _ = dataset
    info = json.loads((path / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 10, 4)
    assert info["features"]["observation.state"]["names"] == STATE
    assert info["features"]["action"]["names"] == ["eSteer.ahead", "eSteer.turn"]
    assert info["features"]["observation.images.photo"]["shape"] == [3, 4, 3]
    episodes = rows_of(path / "meta/episodes/chunk-000/file-000.parquet")
    assert [row["agent"] for row in episodes] == ["r1", "r2", "r1", "r2"]
    assert [row["dataset_from_index"] for row in episodes] == [0, 5, 10, 15]
    assert [row["tasks"] for row in episodes] == [["yard"]] * 4


def test_statistics_are_those_of_all_rows(dataset):
    path, _ = dataset
    statistics = json.loads((path / "meta/stats.json").read_text())
    rows = [row for file in sorted(path.glob("data/*/*.parquet")) for row in rows_of(file)]
    for name in ("observation.state", "action", "observation.scan"):
        values = np.array([row[name] for row in rows])
        for key, expected in (("min", values.min(0)), ("max", values.max(0)),
                              ("mean", values.mean(0)), ("std", values.std(0))):  # fmt: skip
            assert statistics[name][key] == pytest.approx(expected.tolist(), abs=1e-6)
        assert statistics[name]["count"] == [20]
    shades = np.stack([
        np.asarray(Pillow.open(io.BytesIO(row["observation.images.image"]["bytes"])))
        for row in rows
    ]) / 255  # fmt: skip
    shown = np.array(statistics["observation.images.image"]["mean"])
    assert shown.shape == (3, 1, 1)
    assert shown.ravel() == pytest.approx(shades.mean((0, 1, 2)))
    shown = np.array(statistics["observation.images.image"]["std"])
    assert shown.ravel() == pytest.approx(shades.std((0, 1, 2)))


def test_attributes_are_actions_and_every_second_frame_a_row(recorded, tmp_path):
    path = tmp_path / "set"
    words = ["export", str(recorded[1]), "--lerobot", str(path), "--agents", "r2"]
    with pytest.raises(SystemExit) as left:
        app([*words, "--act", "angle", "--act", "gear", "--every", "2", "--to", "3", "--quiet"])
    assert left.value.code == 0
    rows = rows_of(path / "data/chunk-000/file-000.parquet")
    # The attribute after the last frame of each row: frames 1 and 3.
    assert [row["action"] for row in rows] == [[-20.0, 0.0, 1.0], [-30.0, 0.0, 1.0]]
    assert json.loads((path / "meta/info.json").read_text())["fps"] == 5


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({}, "name what is an action of ARover: event types that it receives \\(eSteer\\)"),
        ({"act": ["eSteeer"]}, "did you mean 'eSteer'"),
        ({"act": ["eSteer"], "agents": ["nobody"]}, "--agents: ARover"),
        ({"act": ["eSteer"], "every": 0}, "expected at least 1"),
    ],
)
def test_mistakes_are_reported_and_leave_no_folder(recorded, tmp_path, arguments, says):
    with pytest.raises(MinervaError, match=says):
        export_dataset(recorded[1], tmp_path / "set", "lerobot", **arguments)
    assert not list(tmp_path.iterdir())


def test_the_reader_of_lerobot_reads_it(dataset):
    """Only where lerobot is installed: it needs torch, which is gigabytes."""
    module = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    read = module.LeRobotDataset("minerva/yard", root=dataset[0])
    assert (read.meta.total_episodes, len(read), read.fps) == (4, 20, 10)
    row = read[7]
    assert row["task"] == "yard"
    assert tuple(row["observation.images.photo"].shape) == (3, 3, 4)
    assert row["action"].shape == (2,)
