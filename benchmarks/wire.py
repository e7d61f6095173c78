"""Microseconds to encode and decode messages, optionally for two source trees.

    python -m benchmarks.wire [--against FOLDER] [--json]

One process loads both trees and measures them in turn, so that other load affects both equally. The
times are the minimum over the rounds; a ratio above 1 means that this tree is slower.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
import timeit
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

ROUNDS = 9
SECONDS = 0.02
AGENTS = 2_000
Case = tuple[Callable[[], object], Callable[[], object]]


def load(tree: str | None) -> Mapping[str, Case]:
    """The cases of a source tree; `None` selects this one."""
    hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if _is_ours(name)}
    finders = list(sys.meta_path)  # A tree's own finder maps modules that have moved.
    sys.meta_path[:] = [f for f in finders if not _is_ours(getattr(f, "__module__", ""))]
    root = tree or str(Path(__file__).parents[1])
    sys.path.insert(0, root)
    try:
        loaded = cases(importlib.import_module)
        assert str(sys.modules["minerva_bus"].__file__).startswith(root)
        return loaded
    finally:
        sys.path.remove(root)
        for name in [name for name in sys.modules if _is_ours(name)]:
            del sys.modules[name]
        sys.modules.update(hidden)
        sys.meta_path[:] = finders


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] == "minerva_bus"


def cases(module: Callable[[str], Any]) -> Mapping[str, Case]:
    """Functions to encode and to decode each message, with a tree's modules."""
    m, codec = module("minerva_bus.frame.messages"), module("minerva_bus.wire.codec")
    vocabulary, messages = _messages(module)
    decoder = codec.Decoder(vocabulary)

    def case(message: Any) -> Case:
        make: Callable[[], Any] = message if callable(message) else lambda: message
        sent = make()
        data = codec.encode(sent)
        if isinstance(sent, m.TickRequest | m.EvolveRequest):
            decode = partial(decoder.to_member, data)
        else:
            decode = partial(decoder.from_member, sent.member, data)
        # The first call compiles the decoder, for which it has to find the tree's modules.
        decode()
        return lambda: codec.encode(make()), decode

    return {name: case(message) for name, message in messages.items()}


def _messages(module: Callable[[str], Any]) -> tuple[Any, Mapping[str, Any]]:
    """A vocabulary, and messages by their description, or functions that make them."""
    import numpy as np

    bus, m = module("minerva_bus"), module("minerva_bus.frame.messages")
    column = module("minerva_bus.grammar.column").Column
    columns = module("minerva_bus.grammar.columns").Columns
    ids, scene = module("minerva_bus.grammar.ids").Ids, bus.Scene
    near = bus.EventType("eNear", distance=bus.Metres)

    class Fox(bus.Agent, symbol="AFox"):  # pyright: ignore
        x: float = 0.0
        name: str = ""

        @bus.on("eNear")
        def near(self, event: Any, moment: Any) -> None:
            """Process an event."""

    class Fish(bus.Agent, symbol="AFish"):  # pyright: ignore
        x: float = 0.0

    vocabulary = bus.Vocabulary.of(near, bus.Primitive("PStar", size=bus.Metres), Fox, Fish)
    numbers = np.arange(AGENTS)

    def fishes() -> Any:
        """New columns for each call, because columns cache computed values."""
        of = ids("f", numbers.copy())
        return scene((columns("AFish", ("x",), (column(numbers / 3.0),), AGENTS, of, None),))

    def batch() -> Any:
        of = ids("f", numbers.copy())
        return bus.Events("eNear", ("distance",), (column(numbers / 4.0),), AGENTS, "", of, None)

    foxes = [vocabulary.read(f'AFox#a{n}<x={n}.5, name="fox">()') for n in range(AGENTS)]
    few = tuple(near(0.25 * n) for n in range(10))
    hello = m.Hello(
        "hosts", 6, "Foxes", kinds=(Fox.kind, Fish.kind), generates=("eNear",), topics=("scan",)
    )
    one_each = {f"a{n}": fox for n, fox in enumerate(foxes)}
    messages: Mapping[str, Any] = {
        "tick": m.TickRequest(70_000),
        "ticked, no events": m.TickReply("g", 70_000),
        "ticked, 10 events": m.TickReply("g", 70_000, few),
        "hello": hello,
        "emitted, 2,000 events in columns": lambda: m.Emitted("g", (batch(),)),
        "evolve, 10 events": m.EvolveRequest(70_000, ("h",), few),
        "evolve, 2,000 events in columns": lambda: m.EvolveRequest(70_000, ("h",), (batch(),)),
        "evolved, nothing": m.EvolveReply("h", 70_000),
        "evolved, 2,000 agents": m.EvolveReply("h", 70_000, 0, one_each),
        "evolved, 2,000 agents in columns": lambda: m.EvolveReply("h", 7, 0, {"~f": fishes()}),
        "report": m.Report("h", {"agents": 2000, "load": 0.5}),
    }
    return vocabulary, messages


def measure(trees: list[Mapping[str, Case]]) -> dict[str, list[list[float]]]:
    """Microseconds by message: [encode, decode] of each tree, measured in turn."""
    timings: dict[str, list[list[float]]] = {}
    for name in trees[0]:
        timers = [
            [timeit.Timer(action, timer=time.thread_time) for action in tree[name]]
            for tree in trees
        ]
        counts = [max(1, int(SECONDS / max(timer.timeit(1), 1e-7))) for timer in timers[0]]
        least = [[float("inf")] * 2 for _ in trees]
        for _ in range(ROUNDS):
            for times, tree in zip(least, timers, strict=True):
                for way, timer in enumerate(tree):
                    spent = 1e6 * timer.timeit(counts[way]) / counts[way]
                    times[way] = min(times[way], spent)
        timings[name] = least
    return timings


def main() -> None:
    """Print a line for each message."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--against", help="a source tree to compare with")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    trees = [load(None), *([load(arguments.against)] if arguments.against else [])]
    timings = measure(trees)
    if arguments.json:
        print(json.dumps(timings))
        return
    print(
        f"{'µs':34}{'encode':>10}{'decode':>10}"
        + f"{'encode':>20}{'decode':>10}" * (len(trees) - 1)
    )
    for name, ((encode, decode), *others) in timings.items():
        line = f"{name:34}{encode:10.2f}{decode:10.2f}"
        for old in others:
            ratios = f"({encode / old[0]:.2f} {decode / old[1]:.2f})"
            line += f"{old[0]:20.2f}{old[1]:10.2f}  {ratios}"
        print(line)


if __name__ == "__main__":
    main()
