"""The protocol's pages against the code: tables and examples, and members written from them."""

import itertools
import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from hashlib import blake2b
from pathlib import Path

import msgpack
import pytest

from minerva_bus import Event, Events, Scene
from minerva_bus.frame.messages import PROTOCOL_VERSION
from minerva_bus.grammar.columns import Columns, patched
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.text_and_digest import value_text
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.wire import codec
from minerva_bus.wire.columns_codec import plain_patch
from minerva_bus.wire.plain import DEFAULT
from minerva_bus.wire.strings_codec import Reader, plain_event, plain_scene, plain_value
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.world.context import Context, Frame, Rng, answer_key, hash_of, stream
from minerva_bus.world.evolution import Policy
from tools.protocol_tables import TABLES, protocol, with_tables

DOCUMENT = protocol()
BLOCK = re.compile(r"^```(\w+)(?: (\w+))?\n(.*?)^```$", re.M | re.S)
HEX_LINE = re.compile(r"\s*((?:[0-9a-f]{2}\s{1,2})*[0-9a-f]{2})(?:\s{2,}|$)")


def blocks(language: str, kind: str = "") -> list[str]:
    return [
        body for lang, what, body in BLOCK.findall(DOCUMENT) if (lang, what) == (language, kind)
    ]


def section(title: str) -> str:
    return DOCUMENT.split(f"### {title}", 1)[1].split("\n## ", 1)[0].split("\n### ", 1)[0]


def hexadecimal(body: str) -> tuple[str, bytes]:
    """The first line of an example, and its bytes."""
    first, *lines = body.strip("\n").split("\n")
    matches = [HEX_LINE.match(line) for line in lines]
    assert all(matches), body
    return first.removeprefix("# "), bytes.fromhex(
        "".join(groups[1] for groups in matches if groups)
    )


def examples(kind: str) -> list[tuple[str, bytes]]:
    return [hexadecimal(body) for body in blocks("hex", kind)]


VOCABULARY = read_vocabulary(json.loads(blocks("json", "vocabulary")[0]))
READER = Reader(VOCABULARY)
LIMITS = asdict(DEFAULT)


# --- the version ---


def test_the_version_is_the_same_everywhere() -> None:
    versions = re.findall(r"^Version (\d+)\.$", DOCUMENT, re.M)
    versions += re.findall(r"^\| `version` \| int \| (\d+) \|", DOCUMENT, re.M)
    versions += re.findall(r'"version": (\d+)', blocks("python", "member")[0])
    assert versions == [str(PROTOCOL_VERSION)] * 3


def test_every_policy_is_defined() -> None:
    evolution = DOCUMENT.split("\n## 9. ", 1)[1].split("\n## ", 1)[0]
    assert all(f"`{policy.value}`" in evolution for policy in Policy)


# --- the tables ---


def table(title: str) -> dict[str, int]:
    rows = re.findall(r"^\| `(\w+)`\s*\| (\d+)\s*\|", section(title), re.M)
    return {name: int(count) for name, count in rows}


def test_every_message_of_a_member_is_in_the_document_and_no_other() -> None:
    sizes = {name: message.size for name, message in codec.FROM_MEMBER.items()}
    assert table("From a member, on `from/<member>`") == sizes


def test_every_message_of_the_coordinator_is_in_the_document_and_no_other() -> None:
    sizes = {name: message.size for name, message in codec.TO_MEMBER.items()}
    assert table("From the coordinator") == sizes


def test_every_setting_is_in_the_document() -> None:
    everyone = table("For all subscribers")
    assert everyone == {name: message.size for name, message in codec.FOR_ALL.items()}


def test_the_tables_are_those_of_the_declarations() -> None:
    assert set(re.findall(r"^<!-- table: ([\w ]+) -->$", DOCUMENT, re.M)) == TABLES.keys()
    assert with_tables(DOCUMENT) == DOCUMENT, "python -m tools.protocol_tables --write"


def test_the_limits() -> None:
    rows = re.findall(r"^\| (?:\*\*)?`(\w+)`(?:\*\*)?\s*\| ([\d .]+?)\s*\|", DOCUMENT, re.M)
    numbers = {name: float(most.replace(" ", "")) for name, most in rows if name in LIMITS}
    assert numbers == LIMITS


def test_the_limits_that_a_world_file_sets(tmp_path: Path) -> None:
    bold = re.findall(r"^\| \*\*`(\w+)`\*\*", DOCUMENT, re.M)
    security = (Path(__file__).parents[2] / "docs" / "security.md").read_text(encoding="utf-8")
    table = security.split("\n## Limits\n", 1)[1].split("\n## ", 1)[0]
    assert sorted(bold) == sorted(re.findall(r"^\| `(\w+)` \|", table, re.M))
    (tmp_path / "counting.py").write_text(COUNTING)
    file = tmp_path / "counting.toml"
    limits = "\n".join(f"{name} = 12345" for name in bold)
    file.write_text(f'{WORLD}[process.a]\ncommand = ["true"]\n[limits]\n{limits}\n')
    sys.path.insert(0, str(tmp_path))
    try:
        read = asdict(read_world_file(file).access.limits)
    finally:
        sys.path.remove(str(tmp_path))
        sys.modules.pop("counting", None)
    assert {name: value for name, value in read.items() if value != LIMITS[name]} == dict.fromkeys(
        bold, 12345
    )


# --- the examples in hexadecimal ---


def test_the_vocabulary_is_as_the_code_writes_it() -> None:
    assert plain_vocabulary(VOCABULARY) == json.loads(blocks("json", "vocabulary")[0])
    # Members inherit the vocabulary that the launcher has read.
    assert read_vocabulary(plain_vocabulary(VOCABULARY)) is read_vocabulary(
        plain_vocabulary(VOCABULARY)
    )


@pytest.mark.parametrize(("said", "data"), examples("value"))
def test_values(said: str, data: bytes) -> None:
    plain = msgpack.unpackb(data, ext_hook=msgpack.ExtType)
    wanted = value_text(parse_value(said))
    assert value_text(READER.value(plain)) == wanted
    assert msgpack.packb(plain_value(READER.value(plain))) == data


@pytest.mark.parametrize(("said", "data"), examples("string"))
def test_strings(said: str, data: bytes) -> None:
    scene = READER.scene(msgpack.unpackb(data, ext_hook=msgpack.ExtType))
    assert scene == VOCABULARY.read(said)
    assert str(scene) == said
    assert msgpack.packb(plain_scene(scene)) == data


@pytest.mark.parametrize(("said", "data"), examples("events"))
def test_many_events(said: str, data: bytes) -> None:
    events = READER.event(msgpack.unpackb(data, ext_hook=msgpack.ExtType))
    assert isinstance(events, Events)
    assert ", ".join(map(str, events)) == said
    assert msgpack.packb(plain_event(events)) == data


@pytest.mark.parametrize(
    ("example", "foxes"),
    [
        (0, 'AFox#f0<x=2, name="a">() · AFox#f1<x=4, name="é">()'),
        (1, 'AFox#f1<x=3, name="é">() · AFox#f1:1<x=2.5, name="b">()'),
    ],
)
def test_a_patch(example: int, foxes: str) -> None:
    _, data = examples("patch")[example]
    patch = READER.patch(msgpack.unpackb(data, ext_hook=msgpack.ExtType))
    assert msgpack.packb(plain_patch(patch)) == data
    two, _ = examples("string")[1:]
    (fish,) = READER.scene(msgpack.unpackb(two[1], ext_hook=msgpack.ExtType)).pieces
    assert isinstance(fish, Columns)
    assert Scene((patched(fish, patch),)) == VOCABULARY.read(foxes)


def test_the_digest_of_a_run() -> None:
    """The digest agrees with the document's definition, for agents with a number and a text."""

    def hashed(data: bytes) -> bytes:
        return blake2b(data, digest_size=16).digest()

    ids = hashed(hashed(b"t" + b"".join(b"f%d\n" % n for n in range(32))))
    xs = hashed(hashed(b"n" + struct.pack("<32d", *range(32))))
    names = hashed(hashed(b"t" + '"é"\n'.encode() * 32))
    run = hashed(b"32\0" + b"AFox<x,name>\0" + ids + xs + names)
    text = " · ".join(f'AFox#f{n}<x={n}, name="é">' for n in range(32))
    assert VOCABULARY.read(text).digest == hashed(run)
    assert hashed(run).hex() in DOCUMENT


@pytest.mark.parametrize(("said", "data"), examples("event"))
def test_events(said: str, data: bytes) -> None:
    event = READER.event(msgpack.unpackb(data))
    assert isinstance(event, Event)
    assert str(event) == said
    assert msgpack.packb(plain_event(event)) == data


@pytest.mark.parametrize(("said", "data"), examples("message"))
def test_messages(said: str, data: bytes) -> None:
    plain = json.loads(said)
    assert msgpack.unpackb(data) == plain
    decoder = codec.Decoder(VOCABULARY)
    if plain[0] in codec.FROM_MEMBER:
        message: codec.m.Message = decoder.from_member("someone", data)
    else:
        message = decoder.to_member(data)
    assert codec.encode(message) == data


@pytest.mark.parametrize(("said", "data"), examples("readings"))
def test_readings(said: str, data: bytes) -> None:
    assert msgpack.unpackb(data) == json.loads(said)
    assert codec.encode(codec.Decoder().readings("sightings", "camera", data)) == data


def test_there_are_examples_of_every_sort() -> None:
    assert len(blocks("hex", "value")) == 3
    for kind in ("string", "event", "events", "patch", "message", "readings"):
        assert blocks("hex", kind)


# --- digests, computed from the document's definition ---


def H(data: bytes) -> bytes:
    return blake2b(data, digest_size=16).digest()


def real(number: float) -> str:
    return repr(number).removesuffix(".0")


def digests(flat: list, names: dict[str, list[str]]) -> tuple[bytes, dict[str, bytes]]:
    """The digest of a flat string and those of its nodes by their heads; reals and texts only."""
    queue, hashes = flat[1:], {}

    def nodes(count: int) -> bytes:
        return H(b"".join(node() for _ in range(count)))

    def node() -> bytes:
        symbol, *rest = queue.pop(0)
        owner = f"{symbol}#{rest.pop(0)}" if symbol[0] == "A" else symbol
        values = [
            real(v) if isinstance(v, float) else json.dumps(v, ensure_ascii=False) for v in rest[0]
        ]
        pairs = ", ".join(f"{n}={v}" for n, v in zip(names[symbol], values, strict=True))
        head = f"{owner}<{pairs}>"
        scope = b"" if symbol[0] == "P" else nodes(rest[1])
        hashes[head] = H(head.encode() + b"\0" + scope)
        return hashes[head]

    return nodes(flat[0]), hashes


def test_the_digests_of_the_document() -> None:
    (said, data), *_ = examples("string")
    names = {s: list(VOCABULARY.fields(s).names) for s in ("PStar", "TMove", "AFox")}
    whole, nodes = digests(msgpack.unpackb(data), names)
    listed = {
        what.split(":")[0]: bytes.fromhex(digest)
        for digest, what in re.findall(r"^([0-9a-f]{32})  (.*)$", blocks("digest", "")[0], re.M)
    }
    assert listed["the string"] == whole == VOCABULARY.read(said).digest
    assert listed["ε"] == VOCABULARY.read("ε").digest == H(b"")
    assert listed["the scope of #a"] == H(nodes["PStar<size=1>"])
    assert {head: listed[head] for head in nodes} == nodes


@pytest.mark.parametrize("number", [0.1, 2.0, -0.0, 1e-4, 1e-5, 1e15, 1e16, 2.5e-10, 1 / 3])
def test_reals_are_written_as_documented(number: float) -> None:
    wanted = "-0.0" if struct.pack("d", number) == struct.pack("d", -0.0) else real(number)
    assert value_text(number) == wanted


# --- chance, computed from the document's text ---

WORD = (1 << 64) - 1
M0, M1 = 0xD2E7470EE14C6C93, 0xCA5A826395121157
K0, K1 = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B
assert all(f"0x{constant:X}" in DOCUMENT for constant in (M0, M1, K0, K1))


def philox(key: int) -> Iterator[int]:
    for block in itertools.count(1):
        c, k0, k1 = (block, 0, 0, 0), key & WORD, key >> 64
        for _ in range(10):
            first, second = M0 * c[0], M1 * c[2]
            c = ((second >> 64) ^ c[1] ^ k0, second & WORD, (first >> 64) ^ c[3] ^ k1, first & WORD)
            k0, k1 = (k0 + K0) & WORD, (k1 + K1) & WORD
        yield from c


def mix(z: int) -> int:
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
    return z ^ (z >> 31)


def polynomial(agent: str) -> int:
    total = 0
    for byte in agent.encode():
        total = (total * 0x9E3779B97F4A7C15 + byte) & WORD
    return total


def keyed(size: int, *parts: object) -> int:
    text = "\0".join(map(str, parts)).encode()
    return int.from_bytes(blake2b(text, digest_size=size).digest(), "little")


def number(word: int) -> float:
    return (word >> 11) * 2.0**-53


def vectors() -> list[list[str]]:
    """Test vectors: stream, seed, id, frame, optionally an event type; then the numbers."""
    lines = blocks("streams")[0].strip().split("\n")
    return [
        [*head.split(), *rest.split()[1:]] for head, rest in zip(*[iter(lines)] * 2, strict=True)
    ]


@pytest.mark.parametrize("vector", vectors(), ids=" ".join)
def test_the_streams_of_the_document_are_those_of_the_code(vector: list[str]) -> None:
    kind, seed, who, frame, *rest = vector
    at = (int(seed), int(frame))
    if kind == "philox":
        _, key, *words = rest
        assert keyed(16, seed, who, frame) == int(key, 16)
        drawn = list(itertools.islice(philox(int(key, 16)), len(words)))
        assert drawn == [int(word, 16) for word in words]
        random = stream(at[0], who, at[1])
        assert [random.random() for _ in words] == [number(word) for word in drawn]
        return
    event_type = [rest.pop(0)] if kind == "answers" else []
    _, first, *numbers = rest
    word = mix(polynomial(who) ^ keyed(8, seed, frame, *event_type))
    assert word == int(first, 16)
    Context(Frame(at[1], seed=at[0]), f"#{who}")
    drawing = Context(Frame(at[1], seed=at[0]), f"#{who}").chance
    if event_type:
        drawing = Rng.of(hash_of(who), answer_key(*at, event_type[0]))
    for expected in map(float.fromhex, numbers):
        word = (word + 0x9E3779B97F4A7C15) & WORD
        assert number(mix(word)) == expected == drawing.random()


def test_there_are_vectors_of_every_stream() -> None:
    assert {vector[0] for vector in vectors()} == {"philox", "splitmix64", "answers"}


# --- members written from the document alone ---

COUNTING = """
from minerva_bus import Agent, EventType, Metres, Primitive, Vocabulary, on, view

PBar = Primitive("PBar", length=Metres)
eAdd = EventType("eAdd", amount=float)
eShow = EventType("eShow", visual=True)


class Counter(Agent, symbol="ACounter"):
    total: float = 0.0

    @on("eAdd")
    def add(self, event, moment):
        self.total += event.amount

    @view("eShow")
    def show(self, event):
        return PBar(self.total)


vocabulary = Vocabulary.of(PBar, eAdd, eShow, Counter)
"""

FOREIGN_HOST = """
HELLO |= {
    "kinds": [["ACounter", [["total", "real", "0"]], ["eAdd"], ["eShow"]]],
    "generates": [], "when": "",
}
KEYS = ("all", "evolve", f"to/{NAME}")
FRAGMENTS = {}


def evolve(frame, asked, events, visual, part, only):
    if NAME not in asked:
        return
    changed, views = {}, {}
    for one in only or list(FRAGMENTS):
        count, (symbol, agent, (total,), inside) = FRAGMENTS[one]
        if visual:
            views[one] = [1, ["PBar", [total]]]
        for type_, data, *rest in events:
            if type_ == "eAdd":
                total += data[0]
        new = [1, [symbol, agent, [total], 0]]
        if new != FRAGMENTS[one]:
            changed[one] = FRAGMENTS[one] = new
    send("evolved", frame, part, changed, {}, {"eShow": views} if visual else {})


def hear(name, items):
    if name == "fragments":
        FRAGMENTS.update(items[0])
        for gone in items[1]:
            FRAGMENTS.pop(gone, None)
    elif name == "evolve":
        evolve(*items)
"""

FOREIGN_OBSERVER = """
HELLO |= {"generates": [], "when": "each frame", "draws": ["eShow"]}
KEYS = ("all", "view/eShow", f"to/{NAME}")
SEEN = {}


def hear(name, items):
    if name != "view":
        return
    type_, frame, sequence, parts, skeleton, halted = items
    if skeleton is not None:
        SEEN.clear()
        SEEN["skeleton"] = skeleton
    if "skeleton" in SEEN:
        SEEN["frame"] = frame
        SEEN.update(parts)


def figures():
    slots = [node[1] for node in SEEN["skeleton"][1:]]
    return {"drawn": " ".join(f"{one} {SEEN[one][1][1][0]:g}" for one in slots)}
"""


PLAIN_HOST = """
HELLO |= {
    "kinds": [["ACounter", [["total", "real", "0"]], ["eAdd"], ["eShow"], []]],
    "generates": [], "when": "", "plain": True,
}
KEYS = ("all", "evolve", f"to/{NAME}")
FRAGMENTS = {}


def evolve(frame, asked, events, visual, part, only):
    if NAME not in asked:
        return
    changed, emitted, views = {}, {}, {}
    for one in only:
        count, *nodes = FRAGMENTS[one]
        if visual:
            views[one] = [count, *(["PBar", total] for _, _, total, _ in nodes)]
        new = [count]
        for symbol, agent, (total,), inside in nodes:
            for type_, data, *rest in events:
                if type_ == "eAdd" and (not rest or not rest[2] or agent in rest[2]):
                    total += data[0]
                    if agent == "c3" and data[0] < 1.0:
                        emitted["c3"] = [["eAdd", [100.0], "", "c3", ["c7"]]]
            new.append([symbol, agent, [total], inside])
        if new != FRAGMENTS[one]:
            changed[one] = FRAGMENTS[one] = new
    send("evolved", frame, part, changed, emitted, {"eShow": views} if visual else {})


def hear(name, items):
    if name == "fragments":
        FRAGMENTS.update(items[0])
        for gone in items[1]:
            FRAGMENTS.pop(gone, None)
    elif name == "evolve":
        evolve(*items)
"""

PLAIN_OBSERVER = FOREIGN_OBSERVER.replace('["eShow"]}', '["eShow"], "plain": True}').replace(
    'return {"drawn": " ".join(f"{one} {SEEN[one][1][1][0]:g}" for one in slots)}',
    """bars = [bar for one in slots for bar in SEEN[one][1:]]
    return {"bars": len(bars), "drawn": sum(values[0] for _, values in bars)}""",
)


def foreign(face: str) -> str:
    """The document's member with another `face`, inserted where the listing has its own."""
    (listing,) = blocks("python", "member")
    listing = listing.replace("\n\nconfig = ", f"\n\n{face}\n\nconfig = ", 1)
    listing = listing.replace('("all", "tick", f"to/{NAME}")', "KEYS")
    listing = listing.replace(
        'elif name == "refused"',
        'else:\n            hear(name, items)\n        if name == "refused"',
    )
    if "def figures" in face:
        listing = listing.replace('{"asked": asked}', "figures()")
    return listing


def run(folder: Path, world: str, **scripts: str) -> dict:
    """Run a world of this text and these scripts; returns its summary."""
    (folder / "counting.py").write_text(COUNTING)
    for name, script in scripts.items():
        assert "minerva_bus" not in script
        (folder / f"{name}.py").write_text(script)
        world += f'[process.{name}]\ncommand = ["{sys.executable}", "{folder / name}.py"]\n'
        world += 'on_failure = "stop"\n'
    file = folder / "counting.toml"
    file.write_text(world)
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", "run", str(file), "--json"],
        env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


WORLD = """
[world]
string = "ACounter#c · ACounter#d<total=1>"
vocabulary = "counting:vocabulary"
frames = 5
"""


def digest_after(folder: Path) -> str:
    sys.path.insert(0, str(folder))
    try:
        from counting import vocabulary  # type: ignore[import-not-found]

        return vocabulary.read("ACounter#c<total=12.5> · ACounter#d<total=13.5>").digest.hex()
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop("counting", None)


def test_events_of_the_documented_generator_arrive(tmp_path: Path) -> None:
    """In frame t it adds t + 0.5 to every counter: 12.5 in five frames."""
    world = WORLD + '[process.counters]\nagents = "counting:Counter"\n'
    summary = run(tmp_path, world, far=blocks("python", "member")[0])
    assert summary["frames"] == 5
    assert summary["asked"] == 5
    assert summary["digest"] == digest_after(tmp_path)


def test_a_world_of_foreign_members_only(tmp_path: Path) -> None:
    """Generator, host and observer: the observer's last drawing equals the host's last view."""
    summary = run(
        tmp_path,
        WORLD,
        far=blocks("python", "member")[0],
        host=foreign(FOREIGN_HOST),
        observer=foreign(FOREIGN_OBSERVER),
    )
    assert summary["digest"] == digest_after(tmp_path)
    assert summary["drawn"] == "c 12.5 d 13.5"


POPULATION = " · ".join(f"ACounter#c{n}<total={n}>" for n in range(100))
EMITTING = """
    @on("eAdd")
    def add(self, event, moment):
        self.total += event.amount
        if self.id == "c3" and event.amount < 1:
            moment.emit(eAdd(100.0, receivers=["c7"]))
"""


def test_a_host_and_an_observer_that_decline_columns(tmp_path: Path) -> None:
    """For a population in columns, they receive its agents, events and views one by one."""
    members = {
        "far": blocks("python", "member")[0],
        "observer": foreign(PLAIN_OBSERVER),
        "columns": foreign(FOREIGN_OBSERVER.split("def figures")[0]),
    }
    world = WORLD.replace(WORLD.split('string = "')[1].split('"')[0], POPULATION)
    plain = run(tmp_path, world, **members, host=foreign(PLAIN_HOST))
    assert plain["bars"] == 100
    assert plain["drawn"] == sum(range(100)) + 100 * 12.5 + 100
    whole = tmp_path / "whole"
    whole.mkdir()
    source = COUNTING.replace(COUNTING[COUNTING.index("    @on(") : COUNTING.index("    @view")],
                              EMITTING + "\n")  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(globals(), "COUNTING", source)
        counters = '[process.counters]\nagents = "counting:Counter"\n'
        summary = run(whole, world + counters, **members)
    assert [summary[name] for name in ("digest", "bars", "drawn")] == [
        plain[name] for name in ("digest", "bars", "drawn")
    ]
