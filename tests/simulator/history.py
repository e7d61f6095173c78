"""A history: length and pace of a world, its faults and a person's acts, from one seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count
from random import Random
from typing import Final

from minerva_bus.wire.keys import COORDINATOR
from tests.simulator.worlds import GUESTS, processes

MEMBERS: Final = ("birds", "clerk", "gulls", "lookout", "marsh", "screen", "tide", "water")
FRAMES: Final = 3, 9
RATES: Final = (0.0, 0.0, 50.0, 400.0)
MAX_FAULTS: Final = 6
MAX_KILLS: Final = 3
"""Deaths of one process: fewer than a world file allows."""

NORMS: Final = 0.25
"""The share of histories with norms."""

DIVIDED: Final = 0.25
"""The share of histories in which processes divide the agents of a generator."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault, in seconds after the first begin of a frame (-1: of the world).

    `count`: after this many more messages of the target. `seconds`: its duration, if it has one.
    """

    frame: int
    delay: float
    kind: str
    target: str = ""
    seconds: float = 0.0
    count: int = 0

    def __str__(self) -> str:
        when = "the start" if self.frame < 0 else f"frame {self.frame}"
        more = f" for {self.seconds:.3f} s" if self.seconds else ""
        more += f" after {self.count} more messages" if self.kind == "crash" else ""
        return f"{1000 * self.delay:.2f} ms after {when}: {self.kind} {self.target}{more}"


@dataclass(frozen=True, slots=True)
class Operation:
    """An act of a person, in seconds after the answer to the previous one."""

    wait: float
    ask: str
    number: int = 0

    def __str__(self) -> str:
        return f"{1000 * self.wait:.2f} ms later: {self.ask} {self.number or ''}".rstrip()


@dataclass(frozen=True, slots=True)
class History:
    """Script of a simulation. A person begins to act when frame `acts_from` begins.

    `slow` is the share of messages that are late, `norms`: the world has norms. So many processes
    are `divided` rangers, and as many wardens.
    """

    seed: int
    frames: int
    rate: float
    slow: float
    faults: tuple[Fault, ...] = ()
    acts: tuple[Operation, ...] = ()
    acts_from: int = 0
    norms: bool = False
    divided: int = 0

    def __str__(self) -> str:
        pace = f"{self.rate:g} frames a second" if self.rate else "as fast as it goes"
        lines = [f"seed {self.seed}: {self.frames} frames, {pace}, {self.slow:.0%} slow messages"]
        if self.norms:
            lines[0] += ", with norms"
        if self.divided:
            lines[0] += f", {self.divided} processes for each divided generator"
        lines += [f"  {fault}" for fault in self.faults]
        if self.acts:
            lines.append(f"  from frame {self.acts_from} on, a person")
            lines += [f"    {act}" for act in self.acts]
        return "\n".join(lines)


def drawn(seed: int) -> History:
    """The history of a seed."""
    # A stream of its own: draws of the run itself do not change the history.
    chance = Random(f"history {seed}")
    frames = chance.randint(*FRAMES)
    rate = chance.choice(RATES)
    # About the duration of a frame, so that faults fall into the frame that they name.
    span = 1 / rate if rate else 2e-3
    faults: list[Fault] = []
    for _ in range(chance.randint(0, MAX_FAULTS)):
        fault = _fault(chance, frames, span)
        # With more deaths the launcher would give up the process, as specified, and end the world.
        if _deaths(faults, fault.target) < MAX_KILLS:
            faults.append(fault)
    acts = _acts(chance, span) if chance.random() < 0.6 else ()
    slow = chance.choice((0.0, 0.02, 0.2))
    begin = chance.randrange(frames)
    norms = chance.random() < NORMS
    # Drawn last: the other histories are those without divided generators.
    divided = chance.randint(1, 3) if chance.random() < DIVIDED else 0
    for _ in range(chance.randint(0, 3) if divided else 0):
        fault = _fault(chance, frames, span)
        kind = chance.choice(("kill", "crash", "freeze"))
        target = chance.choice(
            [each.name for each in processes({}, count(), divided)][: 2 * divided]
        )
        if _deaths(faults, target) < MAX_KILLS:
            faults.append(replace(fault, kind=kind, target=target, seconds=0.05))
    return History(seed, frames, rate, slow, tuple(faults), acts, begin, norms, divided)


def _deaths(faults: list[Fault], target: str) -> int:
    return sum(fault.target == target and fault.kind in ("kill", "crash") for fault in faults)


def _fault(chance: Random, frames: int, span: float) -> Fault:
    frame = chance.randint(-1, frames - 1)
    delay = chance.uniform(0, 0.03 if frame < 0 else span)
    kind = chance.choice(_KINDS)
    target = _target(chance, kind)
    seconds = 0.0
    if kind in ("freeze", "stall", "lose views of", "cut", "echo"):
        # From a few messages up to twice the lease of a link.
        seconds = chance.choice((0.003, 0.05, 0.5, 2.0, 6.0)) * chance.uniform(0.5, 1.0)
    count = chance.randint(0, 30) if kind == "crash" else 0
    return Fault(frame, delay, kind, target, seconds, count)


# Repeated entries are weights.
_KINDS: Final = (
    *("kill",) * 3,
    *("crash",) * 4,
    *("freeze",) * 2,
    *("stall",) * 2,
    *("cut",) * 2,
    *("echo",) * 2,
    *("attach",) * 2,
    *("send away",) * 2,
    "lose views of",
)


def _target(chance: Random, kind: str) -> str:
    if kind in ("attach", "send away"):
        return chance.choice(tuple(GUESTS))
    if kind == "lose views of":
        return ""
    if kind in ("stall", "cut", "echo"):
        return chance.choice((*MEMBERS, *GUESTS))
    # The repetition is a weight: three in ten of these faults concern the coordinator.
    return chance.choice((*MEMBERS, *GUESTS, *(COORDINATOR,) * 4))


def _acts(chance: Random, span: float) -> tuple[Operation, ...]:
    acts: list[Operation] = []
    for number in range(1, chance.randint(1, 6) + 1):
        wait = chance.choice((0.0, span, 10 * span)) * chance.random()
        ask = chance.choice(_ASKS)
        acts.append(Operation(wait, ask, chance.randint(1, 3) if ask == "step" else number))
    return tuple(acts)


_ASKS: Final = (
    *("pub eMark",) * 4,
    *("pub eNote",) * 4,
    *("pause",) * 3,
    *("step",) * 4,
    *("resume",) * 2,
    "restart tide",
    "restart birds",
    "drain birds",
    *("kill coordinator",) * 3,
    "stop",
)
