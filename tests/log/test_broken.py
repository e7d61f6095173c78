"""Records that are truncated, damaged, or no records at all."""

import os
import struct
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus.errors import RecordError
from minerva_bus.log.journal import keyframes_in
from minerva_bus.log.record import Record
from minerva_bus.log.record_writer import open_for_record
from tests.log.recorded_runs import bytes_of, record_of, strings_of

mcap = pytest.importorskip("mcap")


def boundaries(data):
    """Offsets of the records in an MCAP file, without its magic bytes."""
    at, ends = 8, []
    while at + 9 <= len(data) and data[at] not in (0, 0x89):
        ends.append(at)
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return [*ends, at]


def frames_in(data, folder, check=True):
    with record_of(data, folder) as record:
        read = list(record.strings(check))
        return record.complete, [frame.number for frame, _ in read], [string for _, string in read]


def cuts(data):
    """Offsets before, at, after and inside each record, and at both ends of the file."""
    places = boundaries(data)
    end = next((place for place in places[:-1] if data[place] == 0x0F), len(data))
    around = [place + by for place in places if place <= end for by in (-1, 0, 4, 9)]
    middles = [(start + end) // 2 for start, end in pairwise(places)]
    return sorted({place for place in [0, 1, 7, 8, *around, *middles] if 0 <= place <= len(data)})


@pytest.mark.parametrize("finished", [True, False])
def test_cut_off_anywhere(finished, tmp_path):
    data = bytes_of("meadow", flush_every=16, finished=finished)
    strings = strings_of("meadow")[1:]
    counts = []
    for cut in cuts(data):
        try:
            complete, numbers, read = frames_in(data[:cut], tmp_path, check=False)
        except RecordError as error:
            assert not counts, "what could be read before must be readable with more of the file"
            assert "\n" not in str(error)
            continue
        counts.append(len(numbers))
        assert numbers == list(range(len(numbers)))
        assert read[-1:] == strings[: len(read)][-1:]  # each string depends on the one before
        assert not complete or len(read) == len(strings)
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == (60 if finished else 48)  # 3 chunks of 16 frames are flushed
    assert set(counts) >= {0, 16, 32, 48}


def test_a_tail_of_zeros_is_a_cut(tmp_path):
    data = bytes_of("meadow", finished=False)
    assert frames_in(data + bytes(5000), tmp_path)[1] == list(range(56))


def test_a_torn_last_chunk_is_a_cut(tmp_path):
    data = bytearray(bytes_of("meadow", finished=False))
    chunk = [place for place in boundaries(data)[:-1] if data[place] == 6][-1]
    data[chunk + 200 : chunk + 300] = bytes(100)
    complete, numbers, _ = frames_in(bytes(data), tmp_path)
    assert not complete
    assert numbers == list(range(48))


def test_another_mcap_file(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "scan.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        writer.finish()
    with pytest.raises(RecordError, match="not a record of Minerva Bus: its profile is 'ros2'"):
        Record(path)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0", b"#ROSBAG V2.0\n", b"[world]\n"])
def test_no_mcap_file(content, tmp_path):
    with pytest.raises(RecordError, match="not an MCAP file"):
        record_of(content, tmp_path)


def test_only_a_header(tmp_path):
    with pytest.raises(RecordError, match="cut off before anything was written"):
        record_of(bytes_of("meadow")[:60], tmp_path)


def test_no_file_and_a_folder(tmp_path):
    with pytest.raises(RecordError, match="No such file"):
        Record(tmp_path / "none.mcap")
    with pytest.raises(RecordError, match="directory"):
        Record(tmp_path)


def test_a_name_that_no_file_has():
    name = Path("a\0.mcap")
    with pytest.raises(RecordError, match="embedded null byte"):
        Record(name)
    with pytest.raises(RecordError, match="cannot be written: embedded null byte"):
        open_for_record(name)


def test_a_format_of_the_future(tmp_path, monkeypatch):
    data = bytes_of("meadow")
    monkeypatch.setattr("minerva_bus.log.entries.FORMAT", 4)
    with pytest.raises(RecordError, match="its format is 3; this version of Minerva Bus reads 4:"):
        record_of(data, tmp_path)


@settings(max_examples=80)
@given(st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), min_size=1, max_size=3))
def test_flipped_bytes_are_errors_of_ours_or_do_no_harm(tmp_path_factory, flips):
    data = bytearray(bytes_of("meadow", finished=True))
    for where, mask in flips:
        data[int(where * (len(data) - 1))] ^= mask
    strings = strings_of("meadow")[1:]
    try:
        with record_of(bytes(data), tmp_path_factory.mktemp("flipped")) as record:
            read = [(frame.number, string) for frame, string in record.strings(check=True)]
            list(record.log())
    except RecordError as error:
        assert "\n" not in str(error)
    else:
        assert all(string == strings[number] for number, string in read)


@given(st.binary(max_size=300))
def test_any_bytes_behind_a_good_header(tmp_path_factory, tail):
    header = bytes_of("meadow")[: boundaries(bytes_of("meadow"))[1]]
    try:
        with record_of(header + tail, tmp_path_factory.mktemp("tail")) as record:
            list(record.frames())
    except RecordError:
        return


def test_a_pipe_or_device_is_no_record(tmp_path):
    """Opening a pipe would wait for a writer."""
    os.mkfifo(tmp_path / "pipe.mcap")
    for path in (tmp_path / "pipe.mcap", Path("/dev/zero")):
        with pytest.raises(RecordError, match="a pipe or device; expected a regular file"):
            Record(path)
        with pytest.raises(RecordError, match="a pipe or device; expected a journal"):
            keyframes_in(path)
