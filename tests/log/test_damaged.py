"""Damaged records: intact parts remain usable, and losses are reported."""

import io
import struct
import subprocess
import sys
import zlib
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus.errors import RecordError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.past import read_resumed
from minerva_bus.log import channels as c
from minerva_bus.log.record_writer import RecordWriter
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from tests.log.recorded_runs import (
    CHECKPOINTS,
    ROOT,
    bytes_of,
    description,
    happened,
    record_of,
    strings_of,
)
from tests.log.test_broken import boundaries

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
pytestmark = pytest.mark.filterwarnings("ignore::minerva_bus.errors.DamagedRecordWarning")

CHUNK, MESSAGE_INDEX, METADATA, DATA_END, FOOTER = 0x06, 0x07, 0x0C, 0x0F, 0x02


def parts(data, opcode):
    """Offsets and total lengths of the records with an opcode."""
    return [
        (at, 9 + struct.unpack_from("<Q", data, at + 1)[0])
        for at in boundaries(data)[:-1]
        if data[at] == opcode
    ]


def frames_of_chunks(data, folder):
    """The frame numbers in each chunk."""
    with record_of(data, folder) as record:
        chunks = record._chunks
        return [
            [message.sequence for _, message in chunks.messages_in(place, (c.FRAME,)) or ()]
            for place in range(len(chunks.places))
        ]


def kept(data, folder, check=True):
    """Numbers of the usable frames, after a check of their strings, and the losses."""
    strings = strings_of("meadow")[1:]
    with record_of(data, folder) as record:
        read = [(frame.number, string) for frame, string in record.strings(check=check)]
        assert all(string == strings[number] for number, string in read)
        return [number for number, _ in read], record.losses()


def flipped(data, at, count=1):
    data = bytearray(data)
    for place in range(at, min(at + count, len(data))):
        data[place] ^= 0xFF
    return bytes(data)


FINISHED = pytest.mark.parametrize("finished", [True, False])


@FINISHED
@pytest.mark.parametrize("chunk", [0, 1, 3, 7])
@pytest.mark.parametrize("where", ["opcode", "length", "sizes", "packing", "data", "zeros"])
def test_a_damaged_chunk_costs_its_own_frames_and_those_up_to_the_next_string(
    where, chunk, finished, tmp_path
):
    data = bytes_of("meadow", finished=finished)
    at, size = parts(data, CHUNK)[chunk]
    offset, count = {
        "opcode": (0, 1), "length": (1, 4), "sizes": (25, 8), "packing": (41, 1),
        "data": (60, 1), "zeros": (0, 0),
    }[where]  # fmt: skip
    broken = flipped(data, at + offset, count)
    if where == "zeros":
        broken = data[:at] + bytes(size) + data[at + size :]
    own = frames_of_chunks(data, tmp_path)
    numbers, losses = kept(broken, tmp_path)
    before = [frame for group in own[:chunk] for frame in group]
    after = [frame for group in own[chunk + 1 :] for frame in group]
    assert numbers[: len(before)] == before
    assert numbers[len(before) :] == after[len(after) - (len(numbers) - len(before)) :]
    if losses.lost:
        assert [frame for span in losses.lost for frame in span] == [
            *range(losses.lost[0].start, numbers[-1] + 1)
        ][: len(losses.lost[0])]
    assert losses.damage or (losses.cut and not finished)
    if own[chunk] and losses.damage:
        assert f"{own[chunk][0]}" in losses.frames


def test_damage_costs_a_part_of_a_run_that_was_faster_than_its_flushes(tmp_path):
    data = bytes_of("meadow", flush_every=1000)
    first, *rest = [frames for frames in frames_of_chunks(data, tmp_path) if frames]
    [chunk] = [n for n, frames in enumerate(frames_of_chunks(data, tmp_path)) if frames == first]
    numbers, _ = kept(flipped(data, parts(data, CHUNK)[chunk][0] + 60), tmp_path)
    assert numbers == [frame for frames in rest for frame in frames] != []


def test_a_run_that_goes_on_says_what_its_record_has_lost(tmp_path):
    path = tmp_path / "run.mcap"
    data = stopped(path)
    path.write_bytes(data[: parts(data, CHUNK)[10][0] + 80])
    notes = read_resumed(path, "", Overrides()).notes
    assert f"{path} was cut off: what its last 80 bytes had is lost" in notes


def test_strings_are_known_again_behind_the_damage(tmp_path):
    """The seventh of nine chunks has a key frame, so the frames after it are usable."""
    data = bytes_of("meadow")
    at, size = parts(data, CHUNK)[3]
    numbers, losses = kept(flipped(data, at + 100), tmp_path)
    first_after = next(n for n in numbers if n > numbers[0] + numbers.index(n))
    assert numbers == [*range(8), *range(first_after, 60)]
    assert losses.lost == (range(8, first_after),)
    assert losses.damaged.startswith(f"bytes {at:,} to {at + size - 1:,} (")
    assert losses.frames == f"frames 8 to {first_after - 1}"


def test_a_copy_without_the_lost_frames_has_the_strings_of_the_others(tmp_path):
    """The first of them is stored as what has changed since the last frame before the damage."""
    data = bytes_of("meadow")
    broken = flipped(data, parts(data, CHUNK)[5][0] + 100)
    with record_of(broken, tmp_path) as record:
        stream = io.BytesIO()
        RecordWriter(stream, record.description, record).finish()
    numbers, _ = kept(broken, tmp_path)
    copied, losses = kept(stream.getvalue(), tmp_path)
    assert copied == numbers
    assert not losses.damage


@pytest.mark.parametrize("opcode", [MESSAGE_INDEX, METADATA])
def test_damage_outside_frames_is_harmless(opcode, tmp_path):
    data = bytes_of("meadow")
    for at, size in parts(data, opcode)[::7]:
        if at > parts(data, DATA_END)[0][0]:
            continue
        for broken in (
            flipped(data, at),
            flipped(data, at + 1, 2),
            data[:at] + bytes(size) + data[at + size :],
        ):
            numbers, losses = kept(broken, tmp_path, check=False)
            assert numbers == list(range(60))
            assert not losses.lost
            assert losses.frames == "no frame"


def test_bytes_that_may_have_been_a_checkpoint_hide_what_was_sent_last(tmp_path):
    data = bytes_of("meadow", flush_every=3, finished=False)
    at, _ = parts(data, CHUNK)[-1]
    with record_of(data[:at] + bytes(40) + data[at:], tmp_path) as record:
        end = record.intact_end()
        assert (end.number, record.last()[0]) == (57, 60)
        assert end.checkpoint.emitted
        assert record.closing_events() == ()
        copied = [message for topic, message in record.messages(end.number) if topic == c.FRAME]
        assert [message.sequence for message in copied] == list(range(end.number))


def test_bytes_that_were_no_message_cost_no_checkpoint(tmp_path):
    data = bytes_of("meadow", flush_every=3, finished=False)
    at, _ = parts(data, CHUNK)[-2]
    copied = []
    for each in (data, data[:at] + bytes(40) + data[at:]):
        with record_of(each, tmp_path) as record:
            copied.append([m.sequence for topic, m in record.messages(60) if topic == c.CHECKPOINT])
    assert copied[0] == copied[1]
    assert copied[0][-3:] == [55, 56, 57]


def test_an_index_that_names_another_channel_hides_nothing(tmp_path):
    data = bytearray(bytes_of("meadow", finished=False))
    for at, _ in parts(data, MESSAGE_INDEX):
        data[at + 9 : at + 11] = b"\xff\x0f"
    assert kept(bytes(data), tmp_path, check=False)[0] == list(range(56))


@pytest.mark.parametrize("part", ["magic", "profile", "library", "header", "begin"])
def test_the_header_may_be_damaged(part, tmp_path):
    data = bytes_of("meadow")
    at, count = {
        "magic": (0, 8), "profile": (21, 1), "library": (32, 5), "header": (8, 9), "begin": (0, 60)
    }[part]  # fmt: skip
    numbers, _ = kept(flipped(data, at, count), tmp_path, check=False)
    assert numbers == list(range(60))
    numbers, _ = kept(data[:at] + bytes(count) + data[at + count :], tmp_path, check=False)
    assert numbers == list(range(60))


def test_the_end_may_be_damaged(tmp_path):
    data = bytes_of("meadow")
    ((end, size),) = parts(data, DATA_END)
    for at in range(end, len(data), 211):
        numbers, losses = kept(flipped(data, at), tmp_path, check=False)
        assert numbers == list(range(60))
        assert not losses.lost
    # A finished record is not taken for one that was cut off, whose end is no damage.
    numbers, losses = kept(data[:end] + bytes(len(data) - end - 8) + data[-8:], tmp_path)
    assert numbers == list(range(60))
    assert losses.damage
    assert not losses.cut
    # Nor is one whose summary is cut, even right after the end of the data.
    for at in (end + size, end + size + 1, len(data) - 1):
        numbers, losses = kept(data[:at], tmp_path, check=False)
        assert (numbers, losses.cut) == (list(range(60)), 0)
        assert [damage.end - damage.begin > 0 for damage in losses.damage] == [True]
    for tail in (b"garbage", bytes(10_000), data):
        numbers, losses = kept(data + tail, tmp_path, check=False)
        assert numbers == list(range(60))


def test_the_description_is_there_twice(tmp_path):
    data = bytes_of("meadow", finished=False)
    (first, size), (second, _) = parts(data, CHUNK)[:2]
    for broken in (
        flipped(data, first + 80),
        flipped(data, second + 80),
        data[:first] + bytes(size) + data[first + size :],
    ):
        assert kept(broken, tmp_path)[0] == list(range(56))
        with record_of(broken, tmp_path) as record:
            assert record.description.world.scene == strings_of("meadow")[0]
            assert record.string(0) == strings_of("meadow")[0]
    with pytest.raises(RecordError, match=r"the description of its world is missing \(byte "):
        record_of(flipped(flipped(data, first + 80), second + 80), tmp_path)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(["flip", "zero", "cut", "insert"]), st.floats(0, 1), st.integers(1, 400)),
        min_size=1, max_size=3,
    ),
    st.booleans(),
)  # fmt: skip
def test_any_damage_is_no_traceback_and_costs_no_frame_before_it(
    tmp_path_factory, damages, finished
):
    folder = tmp_path_factory.mktemp("damaged")
    data = bytes_of("meadow", finished=finished)
    first = len(data)
    for how, where, much in damages:
        at = int(where * (len(data) - 1))
        first = min(first, at)
        if how == "cut":
            data = data[:at]
        elif how == "insert":
            data = data[:at] + bytes(range(1, 256)) * 2 + data[at:]
        else:
            data = (
                flipped(data, at, 1)
                if how == "flip"
                else data[:at] + bytes(much) + data[at + much :]
            )
    whole = bytes_of("meadow", finished=finished)
    own = frames_of_chunks(whole, folder)
    ends = [at + size for at, size in parts(whole, CHUNK)]
    before = [
        frame for group, end in zip(own, ends, strict=True) if end <= first for frame in group
    ]
    try:
        with record_of(data, folder) as record:
            numbers = [frame.number for frame, _ in record.strings(check=True)]
            lost = sum(len(span) for span in record.losses().lost)
            end = record.intact_end().number
            list(record.messages(end))
    except RecordError as error:
        assert "\n" not in str(error)
        assert first < ends[1], error
        return
    assert numbers[: len(before)] == before
    assert len(numbers) + lost <= 60
    assert end <= (numbers[-1] + 1 if numbers else 0) or end <= 60


# --- bombs ---


def bomb(chunks):
    """A record whose chunks are replaced by (data, declared size, checksum)."""
    data = bytes_of("meadow", finished=False)
    first = parts(data, CHUNK)[2][0]
    made = data[:first]
    for packed, declared, crc in chunks:
        body = struct.pack("<QQQII4sQ", 0, 0, declared, crc, 4, b"zstd", len(packed)) + packed
        made += struct.pack("<BQ", CHUNK, len(body)) + body
    return made


def zeros(count):
    import zstandard

    compressor = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    block, left, packed = bytes(1 << 20), count, b""
    while left > 0:
        packed += compressor.compress(block[: min(left, 1 << 20)])
        left -= 1 << 20
    return packed + compressor.flush()


MEASURED = """
import resource, sys, time
from pathlib import Path
from minerva_bus.log.record import Record
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
began = time.process_time()
try:
    with Record(Path(sys.argv[1])) as record:
        print(len([*record.frames()]), record.losses())
except Exception as error:
    print(type(error).__name__, error)
more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(more * 1024, time.process_time() - began)
"""


def measured(data, folder):
    """Output for a file, and its cost in bytes of memory and seconds of CPU time."""
    path = folder / "bomb.mcap"
    path.write_bytes(data)
    words = [sys.executable, "-c", MEASURED, str(path)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
    said, figures = done.stdout.splitlines()
    more, seconds = map(float, figures.split())
    return said, more, seconds


ZEROS = 1 << 30


@pytest.mark.parametrize(
    ("declared", "complaint"),
    [(1000, "unpacks to more than it declares"), (ZEROS, "unpacks to more than a file may hold")],
)
def test_a_chunk_that_unpacks_to_very_much(declared, complaint, tmp_path):
    said, more, _ = measured(bomb([(zeros(ZEROS), declared, 0)]), tmp_path)
    assert complaint in said
    assert more < 32 << 20


def test_many_chunks_of_the_largest_size(tmp_path):
    said, more, _ = measured(bomb([(zeros(64 << 20), 64 << 20, 0)] * 60), tmp_path)
    assert said.count("begin=") == 60
    assert more < 200 << 20


def test_messages_that_pack_to_nothing(tmp_path):
    import zstandard

    data = struct.pack("<BQHIQQ", 5, 22, 3, 0, 0, 0) * 1_000_000
    packed = zstandard.compress(data)
    said, more, _ = measured(bomb([(packed, len(data), zlib.crc32(data))]), tmp_path)
    assert "more messages than a chunk of its size can have" in said
    assert more < 100 << 20


@pytest.mark.parametrize("item", [b"\x90", b"\xc0"])
def test_messages_of_more_items_than_a_record_has(item, tmp_path):
    import zstandard

    body = b"\xdd" + struct.pack(">I", 30_000_000) + item * 30_000_000
    data = struct.pack("<BQHIQQ", 5, 22 + len(body), 3, 0, 0, 0) + body
    packed = zstandard.compress(data)
    said, more, _ = measured(bomb([(packed, len(data), zlib.crc32(data))]), tmp_path)
    assert said.startswith("RecordError")
    assert "frame 0 cannot be read" in said
    assert more < 150 << 20


def test_damage_at_very_many_places_is_gone_over_once(tmp_path):
    chunk = struct.pack("<BQ", CHUNK, 44) + struct.pack("<QQQII4sQ", 0, 0, 0, 0, 4, b"zstd", 0)
    seconds = [
        measured(bytes_of("meadow", finished=False) + (b"\x55" + chunk) * count, tmp_path)[2]
        for count in (3_000, 30_000)
    ]
    assert seconds[1] < 30 * seconds[0]


# --- use of intact parts ---


def stopped(path):
    """Write a record of the meadow with a chunk every four frames; returns its bytes."""
    file, frames = happened("meadow")
    stream = io.BytesIO()
    described = replace(description(file), path=str(file.path))
    writer = RecordWriter(stream, described)
    for (record, string), kept_then in zip(frames, CHECKPOINTS["meadow", None], strict=True):
        writer.frame(record, string, 0.01 * record.frame, {}, kept_then)
        if record.frame % 4 == 3:
            writer.flush()
    writer.finish()
    path.write_bytes(stream.getvalue())
    return stream.getvalue()


@pytest.mark.parametrize("chunk", [5, 10, 16])
def test_a_damaged_record_is_gone_on_from(chunk, tmp_path):
    """The resumed run has the same strings as the run that was never stopped."""
    path, on = tmp_path / "run.mcap", tmp_path / "on.mcap"
    data = stopped(path)
    path.write_bytes(flipped(data, parts(data, CHUNK)[chunk][0] + 80))
    resumed = read_resumed(path, "", Overrides(record=str(on), frames=62))
    assert any("is damaged: bytes" in note for note in resumed.notes)
    strings = {number + 1: string for number, string in enumerate(strings_of("meadow")[1:])}
    begin = resumed.world.past.frame
    assert resumed.world.scene == strings[begin]
    algorithm = FrameAlgorithm(resumed.world)
    lived = {}

    def watch(message):
        if isinstance(message, s.FrameDone):
            lived[message.frame + 1] = algorithm.scene

    runner = InProcessRunner(
        algorithm, [process.make_member() for process in resumed.processes], watch
    )
    runner.start()
    while runner.ended is None:
        runner.handle(s.Begin())
    assert len(lived) == 62 - begin
    assert all(string == strings[number] for number, string in lived.items() if number <= 60)
