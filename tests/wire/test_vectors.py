"""The test vectors in protocol/vectors: up to date, readable without the tool, and as the code."""

import json
import re
import struct
from pathlib import Path
from typing import Any

import msgpack
import pytest

from minerva_bus import Scene
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.grammar.columns import Columns, has_columns, patched, unfolded
from minerva_bus.grammar.events import single
from minerva_bus.grammar.parser import parse_value
from minerva_bus.wire.codec import Decoder, stamped
from minerva_bus.wire.columns_codec import read_ids
from minerva_bus.wire.plain import unpack
from minerva_bus.wire.strings_codec import Reader, plain_value
from minerva_bus.wire.vocabulary_codec import read_vocabulary
from tools.protocol_tables import protocol
from tools.protocol_vectors import FILES, FOLDER, contents

ROOT = Path(__file__).parents[2]
IDENTIFIERS = set(re.findall(r"\[(P\d+\.\d+)\]", protocol()))


def load(name: str) -> Any:
    """The content of a file, as any program reads it."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def untagged(noted: Any) -> Any:
    """Plain data from the notation that docs/reference/protocol/test-vectors.md describes."""
    if isinstance(noted, list):
        return [untagged(item) for item in noted]
    if not isinstance(noted, dict):
        return noted
    match sorted(noted):
        case ["int"]:
            return int(noted["int"])
        case ["float"]:
            return struct.unpack(">d", bytes.fromhex(noted["float"]))[0]
        case ["bytes"]:
            return bytes.fromhex(noted["bytes"])
        case ["bytes", "ext"]:
            return msgpack.ExtType(noted["ext"], bytes.fromhex(noted["bytes"]))
        case _:
            return {key: untagged(value) for key, value in noted["map"]}


def reader(name: str) -> Reader:
    return Reader(read_vocabulary(untagged(load(name)["vocabulary"])))


def cases(*names: str) -> list[Any]:
    return [
        pytest.param(name, case["input"], case["expected"], id=f"{name}: {case['name']}")
        for name in names
        for case in load(name)["cases"]
    ]


def plain(digits: str) -> Any:
    return unpack(bytes.fromhex(digits))


def test_the_files_are_up_to_date() -> None:
    known = {path.name: path.read_text(encoding="utf-8") for path in FOLDER.glob("*.json")}
    assert known == contents(), "python -m tools.protocol_vectors --write"


@pytest.mark.parametrize("name", FILES)
def test_a_file_describes_itself(name: str) -> None:
    document = load(name)
    assert set(document["requirements"]) <= IDENTIFIERS
    assert len(document["description"]) > 20
    labels = [case["name"] for case in document["cases"]]
    assert len(labels) > 2
    assert all(case.keys() == {"name", "input", "expected"} for case in document["cases"])


@pytest.mark.parametrize(("name", "given", "expected"), cases("floats"))
def test_floats(name: str, given: str, expected: Any) -> None:
    (number,) = struct.unpack(">d", bytes.fromhex(given))
    assert struct.pack(">d", float(expected["text"])).hex() == given
    assert struct.pack(">d", plain(expected["msgpack"])).hex() == given
    # No shorter decimal number reads back as the same float64.
    digits = len(re.sub(r"e.*|\D", "", expected["text"]).strip("0"))
    assert digits <= 1 or float(f"%.{digits - 2}e" % number) != number


@pytest.mark.parametrize(("name", "given", "expected"), cases("integers"))
def test_integers(name: str, given: str, expected: Any) -> None:
    assert plain(expected["msgpack"]) == plain(expected["accepted"]) == int(given)
    assert expected["text"] == given


@pytest.mark.parametrize(("name", "given", "expected"), cases("texts"))
def test_texts(name: str, given: list[int], expected: Any) -> None:
    written = "".join(map(chr, given))
    assert plain(expected["msgpack"]) == written
    assert parse_value(expected["text"]) == written


@pytest.mark.parametrize(("name", "given", "expected"), cases("values"))
def test_values(name: str, given: Any, expected: Any) -> None:
    value = reader(name).value(plain(expected["msgpack"]))
    assert msgpack.packb(plain_value(value)).hex() == expected["msgpack"]


@pytest.mark.parametrize(("name", "given", "expected"), cases("strings"))
def test_strings(name: str, given: str, expected: Any) -> None:
    read = reader(name)
    scene = read.scene(plain(expected["msgpack"]))
    assert not has_columns(scene)
    assert (str(scene) or "ε") == given
    assert scene.digest.hex() == expected["digest"] == read.vocabulary.read(given).digest.hex()


@pytest.mark.parametrize(("name", "given", "expected"), cases("digests"))
def test_digests(name: str, given: str, expected: str) -> None:
    scene = reader(name).scene(plain(given))
    assert has_columns(scene)
    assert scene.digest.hex() == unfolded(scene).digest.hex() == expected


@pytest.mark.parametrize(("name", "given", "expected"), cases("columns"))
def test_columns(name: str, given: str, expected: Any) -> None:
    group = reader(name).columns(plain(given))
    assert Scene((group,)) == reader(name).scene(plain(expected["msgpack"]))
    assert str(Scene((group,))) == expected["text"]


@pytest.mark.parametrize(("name", "given", "expected"), cases("ids"))
def test_ids(name: str, given: str, expected: list[str]) -> None:
    assert read_ids(plain(given), len(expected)).texts() == expected


@pytest.mark.parametrize(("name", "given", "expected"), cases("patches"))
def test_patches(name: str, given: Any, expected: Any) -> None:
    read = reader(name)
    old = read.columns(plain(given["columns"]))
    after: Columns = patched(old, read.patch(plain(given["patch"])))
    assert Scene((after,)) == read.scene(plain(expected["msgpack"]))


@pytest.mark.parametrize(("name", "given", "expected"), cases("events"))
def test_events(name: str, given: str, expected: Any) -> None:
    read = reader(name)
    events = [str(event) for event in single([read.event(plain(given))])]
    again = [str(event) for event in read.events(plain(expected["msgpack"]))]
    assert events == expected["text"] == again


@pytest.mark.parametrize(("name", "given", "expected"), cases("messages"))
def test_messages(name: str, given: Any, expected: Any) -> None:
    data = plain(given["msgpack"])
    assert msgpack.packb(untagged(expected)).hex() == given["msgpack"]
    assert isinstance(data[0], str)
    assert given["sender"] in ("member", "coordinator", "anyone")


@pytest.mark.parametrize(("name", "given", "expected"), cases("readings"))
def test_readings(name: str, given: str, expected: Any) -> None:
    assert msgpack.packb(untagged(expected)).hex() == given


@pytest.mark.parametrize(("name", "given", "expected"), cases("epochs"))
def test_epochs(name: str, given: Any, expected: str) -> None:
    assert stamped(bytes.fromhex(expected)) == (
        int(given["epoch"]),
        bytes.fromhex(given["message"]),
    )


@pytest.mark.parametrize(("name", "given", "expected"), cases("refused"))
def test_refused_messages(name: str, given: str, expected: str) -> None:
    assert expected == "refused"
    with pytest.raises((ProtocolError, SceneError)):
        Decoder(reader(name).vocabulary).from_member("g", bytes.fromhex(given))
