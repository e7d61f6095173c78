"""Cases of random streams and of what is drawn from them."""

from __future__ import annotations

from typing import Final

from minerva_bus.world.context import Rng, answer_key, frame_key, hash_of, stream
from minerva_bus.world.population import copy_id
from tools.vectors.notation import Cases, Json, bits

STREAMS: Final = (
    *((7, "a", 3), (0, "rain", 0), (-1, "f1:1", 100), ((1 << 63) - 1, "é", 1 << 40)),
    (-(1 << 63), "x" * 64, 5),
)
DRAWS: Final = 9


def _given(seed: int, who: str, frame: int) -> dict[str, Json]:
    return {"seed": str(seed), "who": who, "frame": str(frame)}


def philox() -> Cases:
    """The first numbers of a member's or an agent's Philox stream."""
    for seed, name, frame in STREAMS:
        who = name if name == "rain" else f"#{name}"
        words = stream(seed, who, frame).bit_generator.random_raw(DRAWS).tolist()
        random = stream(seed, who, frame)
        numbers = [bits(random.random()) for _ in words]
        key = stream(seed, who, frame).bit_generator.state["state"]["key"].tolist()
        expected = {
            "key": [f"{word:016x}" for word in key],
            "words": [f"{word:016x}" for word in words],
            "numbers": numbers,
        }
        yield f"{seed} {who} {frame}", _given(seed, who, frame), expected


def _splitmix(key: int, who: str) -> Json:
    random = Rng.of(hash_of(who), key)
    word = f"{random.word:016x}"
    return {"word": word, "numbers": [bits(random.random()) for _ in range(DRAWS)]}


def splitmix64() -> Cases:
    """The first numbers of an agent's SplitMix64 stream."""
    for seed, who, frame in STREAMS:
        expected = {"hash": f"{hash_of(who):016x}", **_splitmix(frame_key(seed, frame), who)}
        yield f"{seed} {who} {frame}", _given(seed, who, frame), expected


def responses() -> Cases:
    """The stream that decides about events with a probability."""
    for seed, who, frame in STREAMS:
        given = {**_given(seed, who, frame), "event_type": "eNear"}
        yield f"{seed} {who} {frame}", given, _splitmix(answer_key(seed, frame, "eNear"), who)


def distributions() -> Cases:
    """Normal and exponential numbers, each the first of the stream with this word."""
    for word in (0, 3, 1 << 63, (1 << 64) - 1, 0x13DF69F3D588EC2B):
        expected = {
            "normal": bits(Rng(word).normal()),
            "exponential": bits(Rng(word).exponential()),
            "uniform": bits(Rng(word).uniform(-1.0, 3.0)),
            "integer": str(Rng(word).integers(-5, 100)),
        }
        yield f"{word:016x}", {"word": f"{word:016x}"}, expected


COPIES: Final = (("a", 7, 2, 1), ("a", 7, 2, 3), ("a:1", 0, 10, 1), ("x" * 64, 7, 2, 1),
                 ("fox:3-2", 12, 3, 2), (f"{'y' * 30}:{'z' * 33}", 1 << 40, 2, 1))  # fmt: skip


def copies() -> Cases:
    """Ids of copies under the literal policy."""
    for original, frame, number, height in COPIES:
        given = {"id": original, "frame": str(frame), "copy": number, "height": height}
        yield f"{original[:12]} {number} {height}", given, copy_id(original, frame, number, height)
