"""Histories of a world in regions: processes die, links are cut, reports and orders are repeated.

The world is the simulated one without its screen, which has no part in regions. Time is counted in
deliveries, because regions have no time-outs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from typing import Final

from minerva_bus.errors import MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame.phases import Phase
from minerva_bus.grammar.batch import single
from minerva_bus.launch.regions.layout import in_regions
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.partition import ByPosition
from minerva_bus.testing.simulation.cluster import Cluster, DoneFrame
from minerva_bus.testing.simulation.history import Fault, History, Operation
from minerva_bus.testing.simulation.reference import cries_in, orders_in, undisturbed
from minerva_bus.testing.simulation.worlds import ORDERS, eCry, running_ahead, world_file
from minerva_bus.wire.keys import COORDINATOR, name_of_region

COUNTS: Final = 2, 4
FRAMES: Final = 3, 12
MAX_FAULTS: Final = 8
SPAN: Final = 60
"""Deliveries after the begin of a frame within which its faults occur."""

MOST_BALANCED: Final = 4
"""A history without a lag moves the borders after fewer frames than this, or never."""

LAGS: Final = 1, 3
MOVES: Final = 1, 2, 5
"""Every third history has a lag; agents move before the frames that are multiples of a number."""

HOSTS: Final = (), ("birds",), ("birds", "marsh"), (), ()
GUESTS: Final = (), (), (), (), ("birds", "marsh")
"""The agents that have processes of their own in each region, or also have hosts that come and go,
in histories by their seeds."""

BORDERS: Final = 0.0, 1.0, 2.0
"""Borders between regions along x; herons stride across them."""

ABSENT: Final = "screen"
"""The member of the simulated world that a history of regions does not have."""

CRY: Final = "cry"
"""The act of the generator that runs freely."""


@dataclass(frozen=True, slots=True)
class RegionHistory(History):
    """A history of `count` regions; `count` of a fault is the number of deliveries before it.

    `seconds` of a cut are deliveries, too. With a `lag`, agents move before each `every`-th frame.
    """

    count: int = 2
    lag: int = 0
    every: int = 1

    def __str__(self) -> str:
        head = f"seed {self.seed}: {self.frames} frames, {self.count} regions"
        head += f", lag {self.lag}, agents move every {self.every} frames" if self.lag else ""
        lines = [
            f"  {fault.count} deliveries after frame {fault.frame} begins: {fault.kind}"
            f" {fault.target}" + (f" for {fault.seconds:.0f} deliveries" if fault.seconds else "")
            for fault in self.faults
        ]
        lines += [f"  {act.wait:.0f} deliveries later: {act.ask} {act.number}" for act in self.acts]
        return "\n".join([head, *lines])


def drawn_regions(seed: int) -> RegionHistory:
    """The history of a seed."""
    chance = Random(f"regions {seed}")  # noqa: S311
    frames, count = chance.randint(*FRAMES), chance.randint(*COUNTS)
    faults = tuple([_fault(chance, frames, count) for _ in range(chance.randint(0, MAX_FAULTS))])
    asks = [CRY, *(f"pub {name}" for name in ORDERS)]
    acts = [
        Operation(chance.randint(0, SPAN), chance.choice(asks), number)
        for number in range(1, chance.randint(0, 5) + 1)
    ]
    lags = chance.choice(LAGS), chance.choice(MOVES)
    lag, every = lags if seed % 3 == 2 else (0, 1)
    return RegionHistory(seed, frames, 0.0, 0.0, faults, tuple(acts), 0, count, lag, every)


def _lag(history: RegionHistory) -> RegionLag | None:
    partition = ByPosition(BORDERS[: history.count - 1])
    return RegionLag(history.lag, partition, history.every) if history.lag else None


def _fault(chance: Random, frames: int, count: int) -> Fault:
    frame, after = chance.randrange(frames), chance.randint(0, SPAN)
    kind = chance.choice(("kill", "kill", "cut", "cut", "repeat", "succeed"))
    if kind == "succeed":
        return Fault(frame, 0.0, kind, COORDINATOR, 0.0, after)
    if kind != "cut":
        return Fault(frame, 0.0, kind, name_of_region(chance.randrange(count)), 0.0, after)
    a, b = chance.sample(range(count), 2)
    return Fault(frame, 0.0, kind, f"{a}-{b}", float(chance.choice((5, 20, 80))), after)


@dataclass(slots=True)
class RegionScript:
    """The faults and acts of a history as `disturb` of a cluster, and what became of them."""

    history: RegionHistory
    trace: list[str] = field(default_factory=list[str])
    confirmed: list[tuple[str, int]] = field(default_factory=list[tuple[str, int]])
    _delivered: int = 0
    _began: dict[int, int] = field(default_factory=dict[int, int])
    _happened: set[int] = field(default_factory=set[int])
    too_late: bool = False
    _restore_at: int = 0
    _act_at: float = 0.0
    _acted: int = 0

    def __call__(self, cluster: Cluster) -> None:
        """Do what is due before the next delivery."""
        self._delivered += 1
        self._began.setdefault(cluster.algorithm.frame, self._delivered)
        for number, fault in enumerate(self.history.faults):
            began = self._began.get(fault.frame, self._delivered + 1)
            if number not in self._happened and self._delivered >= began + fault.count:
                self._happened.add(number)
                self._do(cluster, fault)
        if cluster.links.cuts and self._delivered >= self._restore_at:
            cluster.restore()
            self._note(cluster, "links are restored")
        self._act(cluster)

    def _do(self, cluster: Cluster, fault: Fault) -> None:
        self._note(cluster, f"{fault.kind} {fault.target}")
        if fault.kind == "kill":
            self.too_late |= cluster.algorithm.phase is Phase.STOPPING
            cluster.start(fault.target)
        elif fault.kind == "succeed":
            cluster.succeed()
        elif fault.kind == "repeat":
            cluster.repeat(fault.target)
        else:
            cluster.links.cuts.add(frozenset(map(int, fault.target.split("-"))))
            self._restore_at = self._delivered + round(fault.seconds)

    def _act(self, cluster: Cluster) -> None:
        acts = self.history.acts[self._acted :]
        if not acts or self._delivered < self._act_at + acts[0].wait:
            return
        self._acted, self._act_at = self._acted + 1, self._delivered
        self._note(cluster, f"{acts[0].ask} {acts[0].number}")
        if acts[0].ask == CRY:
            cluster.emit("gulls", eCry(acts[0].number))
            return
        event_type = acts[0].ask.partition(" ")[2]
        cluster.publish(ORDERS[event_type](acts[0].number))
        self.confirmed.append((event_type, acts[0].number))

    def _note(self, cluster: Cluster, text: str) -> None:
        self.trace.append(f"frame {cluster.algorithm.frame}, delivery {self._delivered}: {text}")


@dataclass(frozen=True, slots=True)
class PlayedRegions:
    """Result of a history: its frames, the confirmed orders and `failure`, if it did not end.

    `figures` are those at the end; None if a process has died when it should have reported.
    """

    history: RegionHistory
    done: tuple[DoneFrame, ...]
    confirmed: tuple[tuple[str, int], ...]
    failure: str
    trace: list[str]
    figures: m.Figures | None

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.done)


def play_regions(history: RegionHistory, folder: Path) -> PlayedRegions:
    """Play a history; journals are in a temporary folder.

    In histories with an odd seed, the coordinator keeps those of regions.
    """
    file = world_file(history.frames, history.rate, folder, {})
    if history.seed % 2 == 0:
        file = replace(file, bus=replace(file.bus, journal=""))
    partition = ByPosition(BORDERS[: history.count - 1], balance=history.seed % MOST_BALANCED)
    if lag := _lag(history):  # Then borders do not move.
        partition, file = lag.partition, replace(file, world=running_ahead(file.world, lag))
    names = file.world.expected - {ABSENT}
    processes = tuple(replace(p, table=p.name) for p in file.processes if p.name in names)
    file = replace(file, processes=processes, hosts=HOSTS[history.seed % len(HOSTS)])
    guests = [p for p in processes if p.name in GUESTS[history.seed % len(GUESTS)]]
    script, failure = RegionScript(history), ""
    with in_regions(replace(file, partition=partition)) as regions:
        chance = Random(f"deliveries {history.seed}")  # noqa: S311
        cluster = Cluster(regions, chance, guests)
        try:
            cluster.run(script)
        except MinervaError as error:
            failure = f"{type(error).__name__}: {error}"
    done, ended = tuple(cluster.done), cluster.runner.ended
    figures = None if ended is None or script.too_late else ended.figures
    return PlayedRegions(history, done, tuple(script.confirmed), failure, script.trace, figures)


def wrong_regions(played: PlayedRegions) -> Iterator[str]:
    """Violated properties, one line each."""
    if played.failure:
        yield played.failure
    history = played.history
    events = [[*single(frame.events)] for frame in played.done]
    orders = [orders_in(iter(sent)) for sent in events]
    cries = [tuple((eCry.name, n) for n in cries_in(iter(sent))) for sent in events]
    outside = [(*a, *b) for a, b in zip(orders, cries, strict=True)]
    due = tuple((number, sent) for number, sent in enumerate(outside) if sent)
    same = undisturbed(history.frames, due, _lag(history))
    if not played.failure and len(played.done) != len(same.digests):
        yield f"it ended after {len(played.done)} frames, not {len(same.digests)}"
    for number, frame in enumerate(played.done):
        texts, wanted = [*map(str, events[number])], [*same.events[number]]
        if frame.number != number or texts != wanted:
            yield f"frame {number} has the events {texts[:9]}, not {wanted[:9]}"
        if frame.digest != same.digests[number]:
            yield f"frame {number} has another digest, {frame.digest[:8]}"
            return  # All later frames would differ as a consequence.
    yield from _wrong_figures(played.figures, same.figures)
    yield from _wrong_orders(played, [order for sent in orders for order in sent])
    yield from _repeated([cry for sent in cries for cry in sent])


def _wrong_figures(figures: m.Figures | None, expected: m.Figures) -> Iterator[str]:
    """Services have been shown the same views, and norms have counted the same acts."""
    for name, value in expected.items() if figures is not None else ():
        if (figures or {}).get(name) != value:
            yield f"{name} is {(figures or {}).get(name)} at the end, not {value}"


def _repeated(counted: list[tuple[str, int]]) -> Iterator[str]:
    for (name, number), times in sorted(Counter(counted).items()):
        if times > 1:
            yield f"{name} {number} is in {times} frames"


def _wrong_orders(played: PlayedRegions, counted: list[tuple[str, int]]) -> Iterator[str]:
    """An order counts once; those of the last frames may come too late for any."""
    yield from _repeated(counted)
    if sorted(counted, key=played.confirmed.index) != [*played.confirmed[: len(counted)]]:
        yield f"the orders {counted} count, of {played.confirmed}"
