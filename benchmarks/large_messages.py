"""Costs of the largest allowed message of each type for the other members, over real Zenoh.

    python -m benchmarks.large_messages [--only NAME ...] [--repeat 3] [--json]

A world runs 20 frames per second with a lockstep generator, a host of 200 agents, and an observer
that sends a query every 20 ms. A member that implements only the protocol joins, sends the largest
message of a type within the limits, or a flood of messages, and leaves. The metrics are relative to
the second before the message:

frame    maximum delay of a frame after the message, in ms
path     maximum CPU time of the coordinator's main thread between the beginning and the end of a
         frame, in ms: an estimate of `frame` on an idle machine, without the share of the hosts
silence  longest response time of a query, in ms
cost     path, and `decode` if the frame waits for the message

`decode` is the CPU time to decode the message on its own. All values are medians of the
repetitions, except for `frame` and `silence`, which are the lowest: other programs of the machine
only increase them. `--only` takes a part of a name. Messages are encoded before they are sent, so
that their construction does not count.
"""

from __future__ import annotations

import argparse
import json
import statistics
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from benchmarks.command import Table
from benchmarks.forked import task
from benchmarks.large_message_cases import CASES, VOCABULARY, Case, hello
from benchmarks.large_message_world import NAME, RATE, Raw, running
from minerva_bus.errors import MinervaError
from minerva_bus.runtime.session import open_client
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.keys import Keys
from minerva_bus.wire.plain import pack

LOWEST = ("frame", "silence")
CALM, SETTLED = 1.0, 30.0
BROKEN = "broke the protocol"
"""Part of the log line about a refused message."""


def asking(
    session: zenoh.Session, stop: threading.Event, answers: list[tuple[float, float]]
) -> None:
    asked = pack({"ask": "vocabulary"})
    while not stop.is_set():
        began = time.monotonic()
        replies = list(session.get(Keys(NAME).control, payload=asked, timeout=30.0))
        answers.append((began, time.monotonic() - began if replies else 30.0))
        time.sleep(0.02)


def measured(case: Case) -> dict[str, float]:
    """Costs of one message in ms."""
    answers, stop = list[tuple[float, float]](), threading.Event()
    with running(host=case.answers != "evolve") as (endpoint, frames, lines):
        with open_client("asking", endpoint) as other, open_client("large", endpoint) as session:
            if case.answers != "evolve":
                frames.get(timeout=SETTLED)
            watch = threading.Thread(target=asking, args=(other, stop, answers))
            watch.start()
            lone = case.data is None and case.flood is None and case.question is None
            if lone:
                time.sleep(CALM)
            raw = Raw(session, case)
            (raw.refused if lone else raw.welcome).wait(SETTLED)
            at = raw.greeted_at if lone else _send(session, raw, case)
            time.sleep(2 * CALM)
            stop.set()
            watch.join()
        ends = list(_drained(frames))
    # A message that is refused, unlike what the case says, would measure something else.
    refusals = [line for line in lines if BROKEN in line]
    if bool(refusals) != case.refused and not lone:
        raise SystemExit(f"expected refused: {case.refused}; the log has {lines}")
    return _figures(at, ends, answers)


def _send(session: zenoh.Session, raw: Raw, case: Case) -> float:
    time.sleep(CALM)
    if case.flood is not None:
        at = time.monotonic()
        case.flood(session, raw.keys, raw.epoch, at + CALM)
        return at
    if case.answers:
        raw.armed.set()
        until = time.monotonic() + SETTLED
        while not raw.sent_at and time.monotonic() < until:
            time.sleep(0.01)
        return raw.sent_at
    at = time.monotonic()
    if case.question is None:
        raw.send_message(0)
    else:
        list(session.get(raw.keys.control, payload=pack(case.question()), timeout=SETTLED))
    return at


def _drained(frames: SimpleQueue[tuple[int, float, float]]) -> Iterator[tuple[int, float, float]]:
    with suppress(Empty):
        while True:
            yield frames.get_nowait()


def _figures(
    at: float, ends: list[tuple[int, float, float]], answers: list[tuple[float, float]]
) -> dict[str, float]:
    gaps = [(b - a, b) for (_, a, _), (_, b, _) in pairwise(ends)]
    paths = [(path, end) for _, end, path in ends]
    usual = statistics.median([took for took, end in paths if end <= at] or [0.0])
    path = max([took for took, end in paths if end > at], default=0.0) - usual
    before = [gap for gap, end in gaps if at - CALM < end <= at] or [1 / RATE]
    after = [gap for gap, end in gaps if end > at] + [max(0.0, time.monotonic() - ends[-1][1] - 3)]
    busy = max([took for begun, took in answers if begun + took >= at], default=0.0)
    return {
        "frame": 1e3 * (max(after) - statistics.median(before)),
        "path": 1e3 * path,
        "silence": 1e3 * busy,
    }


def encoded(case: Case) -> bytes:
    """The case's message, or its hello."""
    if case.question is not None:
        return pack(case.question())
    return pack(["hello", hello() | case.hello]) if case.data is None else case.data().of(0)


def alone(case: Case) -> float:
    """Milliseconds to decode the message on its own."""
    data = encoded(case)
    began = time.thread_time()
    with suppress(MinervaError):
        Decoder(VOCABULARY).from_member("large", data)
    return 1e3 * (time.thread_time() - began)


def row(name: str, repeat: int) -> dict[str, Any]:
    """One row of the table."""
    case, rows = CASES[name], list[dict[str, float]]()
    for _ in range(repeat):  # Zenoh's threads do not survive a fork: use new processes.
        rows.append(task("benchmarks.large_messages", name))
    lowest = {key: min(row[key] for row in rows) for key in LOWEST}
    figures = {key: statistics.median(row[key] for row in rows) for key in rows[0]} | lowest
    flood = case.flood is not None
    decode = 0.0
    if not flood and case.question is None:
        decode = min(alone(case) for _ in range(repeat))
    own = {"case": name, "bytes": 0 if flood else len(encoded(case)), "decode": round(decode, 1)}
    # The frame waits for the decoding of an answer; other messages are decoded beside it.
    awaited = decode if case.answers and not case.refused else 0.0
    own |= {"cost": round(figures["path"] + awaited, 1)}
    return own | {key: round(figure, 1) for key, figure in figures.items()}


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--task", choices=sorted(CASES), help="one case, in this process")
    options = parser.parse_args()
    if options.task:
        print(json.dumps(measured(CASES[options.task])))
        return
    names = [name for name in CASES if any(part in name for part in options.only)]
    keys = ("bytes", "decode", "path", "cost", "frame", "silence")
    table = Table({"ms": "<26"} | dict.fromkeys(keys, ">13,"), as_json=options.json)
    for name in names:
        figures = row(name, options.repeat)
        table.row(figures, name, *(figures[key] for key in keys))


if __name__ == "__main__":
    main()
