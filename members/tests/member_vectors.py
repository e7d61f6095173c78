"""Questions about protocol/vectors for the test programs of members in compiled languages.

A program reads a question on each line of its standard input and prints the answer on a line:
`data HEX` (the value as text), `again HEX` (its encoding), `vocabulary HEX`, `string HEX` (number
of nodes), `event HEX` (its encoding), `reading HEX`, `batch HEX` (Zenoh), `name HEX`,
`epoch NUMBER` and `philox SEED WHO FRAME COUNT`. What it cannot read is answered by `refused`.
"""

import json
import random
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgpack

FOLDER = Path(__file__).parents[2] / "protocol" / "vectors"
SECONDS = 60


def load(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def answers(words: Sequence[str], questions: Sequence[str]) -> list[str]:
    """Ask a program all questions; it must end well."""
    text = "".join(f"{question}\n" for question in questions)
    done = subprocess.run(words, input=text, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stderr == ""
    return [line.rstrip() for line in done.stdout.splitlines()]


def shown(noted: Any) -> str:
    """A value in the notation of docs/reference/protocol/test-vectors.md, as the programs print it."""
    match noted:
        case None | bool():
            return {None: "n", True: "t", False: "f"}[noted]
        case int():
            return f"i{noted}"
        case str():
            return f"s{noted.encode('utf-8', 'surrogatepass').hex()}"
        case list():
            return f"[{','.join(map(shown, noted))}]"
        case {"int": number}:
            return f"i{number}"
        case {"float": bits}:
            return f"r{bits}"
        case {"ext": kind, "bytes": data}:
            return f"x{kind}:{data}"
        case {"bytes": data}:
            return f"b{data}"
        case {"map": pairs}:
            return "{" + ",".join(f"{shown(key)},{shown(value)}" for key, value in pairs) + "}"
    raise AssertionError(noted)


def packed(noted: Any) -> bytes:
    """A vocabulary in that notation, as MessagePack."""

    def plain(noted: Any) -> Any:
        match noted:
            case list():
                return [plain(item) for item in noted]
            case {"float": bits}:
                return msgpack.unpackb(bytes.fromhex(f"cb{bits}"))
            case {"map": pairs}:
                return {key: plain(value) for key, value in pairs}
        return noted

    return msgpack.packb(plain(noted))


def _values() -> Iterator[tuple[str, str]]:
    for case in load("floats")["cases"]:
        yield f"data cb{case['input']}", f"r{case['input']}"
        yield f"again {case['expected']['msgpack']}", case["expected"]["msgpack"]
    for case in load("integers")["cases"]:
        expected = case["expected"]
        yield f"again {expected['accepted']}", expected["msgpack"]
        yield f"data {expected['msgpack']}", f"i{case['input']}"
    for case in load("texts")["cases"]:
        text = "".join(map(chr, case["input"]))
        yield f"data {case['expected']['msgpack']}", f"s{text.encode().hex()}"
        yield f"again {case['expected']['msgpack']}", case["expected"]["msgpack"]
    for case in load("values")["cases"]:
        yield f"again {case['expected']['msgpack']}", case["expected"]["msgpack"]


def _messages() -> Iterator[tuple[str, str]]:
    for case in load("messages")["cases"]:
        yield f"data {case['input']['msgpack']}", shown(case["expected"])
        yield f"again {case['input']['msgpack']}", case["input"]["msgpack"]
    for case in load("readings")["cases"]:
        yield f"data {case['input']}", shown(case["expected"])
        yield f"reading {case['input']}", "read"
    for case in load("epochs")["cases"]:
        message = case["input"]["message"]
        yield f"epoch {case['input']['epoch']}", case["expected"].removesuffix(message)
    for case in load("names")["cases"]:
        name = case["input"].encode().hex()
        yield f"name {name}", "true" if case["expected"] else "false"


def _scenes() -> Iterator[tuple[str, str]]:
    strings = load("strings")
    yield f"vocabulary {packed(strings['vocabulary']).hex()}", "read"
    for case in strings["cases"]:
        data = case["expected"]["msgpack"]
        yield f"string {data}", str(len(msgpack.unpackb(bytes.fromhex(data))) - 1)
    events = load("events")
    yield f"vocabulary {packed(events['vocabulary']).hex()}", "read"
    for case in events["cases"]:
        # Batches are columns, which these members decline.
        is_single = case["input"][:2] in ("92", "95") and case["expected"] != "refused"
        answer = case["expected"]["msgpack"].removeprefix("91") if is_single else "refused"
        yield f"event {case['input']}", answer


def _streams() -> Iterator[tuple[str, str]]:
    for case in load("philox")["cases"]:
        given, expected = case["input"], case["expected"]
        numbers = [*expected["words"], *expected["numbers"]]
        count = len(expected["words"])
        assert count == len(expected["numbers"])
        if " " not in given["who"]:
            question = f"philox {given['seed']} {given['who']} {given['frame']} {count}"
            yield question, " ".join(numbers)


def questions() -> list[tuple[str, str]]:
    """Questions with their answers."""
    return [*_values(), *_messages(), *_scenes(), *_streams()]


def check_vectors(words: Sequence[str]) -> None:
    """Compare the answers of a program with the vectors."""
    pairs = questions()
    assert len(pairs) > 300
    received = answers(words, [question for question, _ in pairs])
    assert len(received) == len(pairs)
    for (question, expected), answer in zip(pairs, received, strict=True):
        assert answer == expected, question


def garbage(count: int) -> list[str]:
    """Questions about broken bytes: cut, changed, repeated."""
    chance = random.Random(7)
    valid = [question.split(" ", 1) for question, _ in questions() if "vocab" not in question]
    valid += [["batch", data] for data in BATCHES]
    result = [next(question for question, _ in _scenes())]
    while len(result) < count:
        kind, data = chance.choice([pair for pair in valid if pair[0] not in ("epoch", "philox")])
        broken = bytearray.fromhex(data)
        for _ in range(chance.randrange(1, 4)):
            place = chance.randrange(len(broken) + 1)
            match chance.randrange(4):
                case 0:
                    del broken[place:]
                case 1 if place < len(broken):
                    broken[place] = chance.randrange(256)
                case 2:
                    broken[place:place] = chance.randbytes(chance.randrange(1, 5))
                case _:
                    broken += broken[place : place + 20]
        result.append(f"{kind} {broken.hex() or 'c1'}")
    return result


BATCHES = (
    "21093201020304" + "0affff" + "02aabb",
    "62030002aabb",
    "04",
    "25001e22010000",
    "2500" + "1e2201000d6d696e657276612f772f616c6c" + "1e1a",
    "2503" + "bd00136d696e657276612f772f66726f6d2f7261696e210d010a0091a76c656176696e67",
    "2502" + "1e260300146d696e657276612f772f616c6976652f7261696e" + "1e0703",
    "4600aabbcc",
    "2300",
)


def check_garbage(words: Sequence[str], count: int = 5000) -> None:
    """A program answers each question about broken bytes, and still answers afterwards."""
    received = answers(words, [*garbage(count), "data 07"])
    assert len(received) == count + 1
    assert received[-1] == "i7"
    assert received.count("refused") > count // 10
