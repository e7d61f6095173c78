"""A warehouse: a manager announces transports, carriers bid, and the best bid wins.

They exchange information only in messages: one FIPA contract net (SC00029) per transport.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from minerva_bus import (
    EMPTY,
    Context,
    Default,
    Degrees,
    Disc,
    Event,
    EventType,
    Generator,
    Label,
    Line,
    Metres,
    MinervaError,
    Motion,
    Primitive,
    Scene,
    Tick,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)
from minerva_bus.grammar.scene import FigureNode
from minerva_messages import CONTRACT_NET, MESSAGES, Conversation, Talker

WIDTH, HEIGHT, HOME, AISLE = 24.0, 9.0, 1.0, 0.8  # metres
SPEED, FULL, CHARGED = 0.45, 100.0, 1.5  # metres: per frame; per full charge; charged per frame
BID_FRAMES, CALL_FRAMES = 6, 20  # frames within which bids count, and between calls
MISHAP_PROBABILITY = 0.05  # that a carrier does not find its box
ROWS = {"A": 3.2, "B": 6.8}
SHELVES = {f"{row}{n}": (3.0 * n + 1.0, y) for row, y in ROWS.items() for n in range(1, 6)}
DOCKS = {"north": (22.0, 6.8), "south": (22.0, 3.2)}
DESK = (1.0, 8.05)

# --- the vocabulary: pictures and messages --------------------------------------------------------

Points = tuple[float, ...]
PFloor = Primitive(
    "PFloor", Line("xs", "ys", "#c9c2b8", 0.12, meaning="edge of the floor"), xs=Points, ys=Points
)
PShelf = Primitive("PShelf", Line("xs", "ys", "#8a7f74", 0.5), xs=Points, ys=Points)
PDock = Primitive("PDock", Line("xs", "ys", "#2f6f8f", 0.9), xs=Points, ys=Points)
PCharger = Primitive(
    "PCharger", Disc("radius", "#dfe7d8", meaning="charging station"), radius=Metres
)
PCarrier = Primitive(
    "PCarrier",
    Disc("radius", "#d9641e", heading=True, meaning="carrier with a contract"),
    radius=Metres,
)
PResting = Primitive(
    "PResting",
    Disc("radius", "#a8adb5", heading=True, meaning="carrier without a contract"),
    radius=Metres,
)
PBox = Primitive("PBox", Disc("radius", "#7a4a21"), radius=Metres)
PCharge = Primitive(
    "PCharge",
    Line("xs", "ys", "#4f8049", 0.12, meaning="charge of a carrier"),
    xs=Points,
    ys=Points,
)
PRoute = Primitive(
    "PRoute",
    Line("xs", "ys", "#e7b48f", 0.05, dashed=True, meaning="planned route"),
    xs=Points,
    ys=Points,
)
PSign = Primitive(
    "PSign", Label("text", "#2b2b33", meaning="name, or the state of orders"), text=str
)
PJob = Primitive("PJob", source=str, target=str)
TPlace = Transformation(
    "TPlace", Motion("x", "y", "angle"), x=Metres, y=Metres, angle=Default(Degrees, 0)
)

eStep = EventType("eStep")
eOrder = EventType("eOrder", source=str, target=str)
ePicture = EventType("ePicture", visual=True)


def way(points: list[tuple[float, float]]) -> float:
    """Length of the path through these points in metres."""
    return sum(portable.dist(a, b) for a, b in pairwise(points))


def route(x: float, y: float, to: tuple[float, float]) -> list[tuple[float, float]]:
    """The points of the path to a position: out to the aisle, along it, and in."""
    return [(x, y), to] if x == to[0] else [(x, y), (x, AISLE), (to[0], AISLE), to]


# --- the agents -----------------------------------------------------------------------------------


class Manager(Talker, symbol="AManager"):
    """Announces one transport at a time, awards it to the best bid, and counts completed ones."""

    carriers: tuple[str, ...] = ()
    waiting: tuple[str, ...] = ()
    done: int = 0

    @on("eOrder")
    def note(self, order: Event, moment: Context) -> None:
        job = str(PJob(order.source, order.target))
        if read_job(job):  # unknown shelves and docks are ignored
            self.waiting += (job,)

    @on("eStep")
    def manage(self, step: Event, moment: Context) -> None:
        self.expire(moment)
        bids = self.conversations(CONTRACT_NET, state="proposed")
        if self.conversations(CONTRACT_NET, state="called"):
            return  # answers are missing
        if bids:
            best = min(bids, key=lambda bid: (float(bid.content), bid.peer))
            self.award(moment, bids, best, self.waiting[0], language="minerva")
            self.waiting = self.waiting[1:]
        elif self.waiting and moment.number % CALL_FRAMES == 0:
            by = moment.number + BID_FRAMES
            job = self.waiting[0]
            self.open(moment, CONTRACT_NET, self.carriers, job, language="minerva", reply_by=by)

    def received(self, message: Event, conversation: Conversation | None, moment: Context) -> None:
        match conversation.state if conversation else "":
            case "proposed" if not message.content.replace(".", "", 1).isdecimal():
                self.say(moment, conversation, "not-understood", "expected a number")
            case "done":
                self.done += 1
            case "failed":  # announce it again
                self.waiting += (message.content,)

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        sign = f"{self.done} done, {len(self.waiting)} waiting"
        return TPlace(DESK[0], DESK[1])(PSign(sign))


class Carrier(Talker, symbol="ACarrier"):
    """Fulfils its contract, from shelf to dock; `battery` is the remaining range in metres."""

    x: Metres
    y: Metres
    home: Metres
    heading: Degrees = 90.0
    battery: Metres = FULL
    loaded: bool = False

    def received(self, message: Event, conversation: Conversation | None, moment: Context) -> None:
        match conversation.state if conversation else "":
            case "called":
                self.bid(conversation, moment)
            case "accepted" if read_job(conversation.content) is None:
                self.say(moment, conversation, "failure", "expected PJob<source, target>")

    def bid(self, call: Conversation, moment: Context) -> None:
        job = read_job(call.content)
        if job is None:
            self.say(moment, call, "not-understood", "expected PJob<source, target>")
            return
        there, back = SHELVES[job[0]], DOCKS[job[1]]
        cost = way(route(self.x, self.y, there)) + way(route(*there, back))
        if self.contract:
            self.say(moment, call, "refuse", "busy")
        elif cost + way(route(*back, (HOME, self.home))) > self.battery:
            self.say(moment, call, "refuse", "battery low")
        else:
            self.say(moment, call, "propose", f"{cost * FULL / self.battery:.1f}")

    @property
    def contract(self) -> Conversation | None:
        """The accepted contract; part of the state, like all conversations."""
        return next(iter(self.conversations(CONTRACT_NET, state="accepted")), None)

    @property
    def goal(self) -> tuple[float, float]:
        """The current destination."""
        job = read_job(self.contract.content) if self.contract else None
        if job is None:
            return HOME, self.home
        return DOCKS[job[1]] if self.loaded else SHELVES[job[0]]

    @on("eStep")
    def live(self, step: Event, moment: Context) -> None:
        if (self.x, self.y) == (HOME, self.home):
            self.battery = min(FULL, self.battery + CHARGED)
        if (self.x, self.y) != self.goal:
            self.drive()
        elif self.contract:
            self.handle(self.contract, moment)

    def drive(self) -> None:
        x, y = next(cell for cell in route(self.x, self.y, self.goal) if cell != (self.x, self.y))
        length = portable.dist((self.x, self.y), (x, y))
        self.heading = math.degrees(portable.atan2(y - self.y, x - self.x))
        share = min(1.0, SPEED / length)
        self.battery = max(0.0, self.battery - share * length)
        if share == 1.0:
            self.x, self.y = x, y
        else:
            self.x += share * (x - self.x)
            self.y += share * (y - self.y)

    def handle(self, contract: Conversation, moment: Context) -> None:
        if self.loaded:
            self.say(moment, contract, "inform", contract.content)
            self.loaded = False
        elif moment.random.random() < MISHAP_PROBABILITY:
            self.say(moment, contract, "failure", contract.content)
        else:
            self.loaded = True

    @view("ePicture")
    def picture(self, event: Event) -> Scene:
        body = PCarrier(0.42) if self.contract else PResting(0.42)
        cargo = PBox(0.24) if self.loaded else EMPTY
        left = 0.9 * self.battery / FULL
        charge = TPlace(self.x - 0.45, self.y + 0.65)(PCharge((0.0, left), (0.0, 0.0)))
        return self.plan() + TPlace(self.x, self.y, self.heading)(body + cargo) + charge

    def plan(self) -> Scene:
        points = route(self.x, self.y, self.goal) if self.contract else []
        xs, ys = tuple(x for x, _ in points), tuple(y for _, y in points)
        return PRoute(xs, ys) if points else EMPTY


def read_job(text: str) -> tuple[str, str] | None:
    """Shelf and dock of a job, a string of the world's own language; None if it is invalid."""
    try:
        (job,) = vocabulary.read(text)
    except (MinervaError, ValueError):
        return None
    parameters = job.parameters if isinstance(job, FigureNode) and job.symbol == PJob.name else {}
    source, target = parameters.get("source"), parameters.get("target")
    return (source, target) if source in SHELVES and target in DOCKS else None


# --- orders ---------------------------------------------------------------------------------------


class Shop(Generator, events=("eOrder",)):
    """Random orders, and those of people.

    Args:
        chance: probability of an order per frame.

    """

    def __init__(self, chance: float = 0.03) -> None:
        self.chance = chance

    def takes_orders(self) -> tuple[str, ...]:
        return self.events

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield from tick.orders
        if tick.random.random() < self.chance:
            shelf, dock = tick.random.choice(sorted(SHELVES)), tick.random.choice(sorted(DOCKS))
            yield eOrder(str(shelf), str(dock))


vocabulary = Vocabulary.of(
    *(PFloor, PShelf, PDock, PCharger, PCarrier, PResting, PBox, PCharge, PRoute, PSign, PJob),
    *(TPlace, eStep, eOrder, ePicture, Manager, Carrier, *MESSAGES),
)


def scene(options: dict[str, int]) -> Scene:
    """The hall, its manager, and the carriers at their chargers."""
    xs, ys = (0.0, WIDTH, WIDTH, 0.0, 0.0), (0.0, 0.0, HEIGHT, HEIGHT, 0.0)
    hall = PFloor(xs, ys)
    for name, (x, y) in sorted(SHELVES.items()):
        hall += TPlace(x + 0.9, y)(PShelf((0.0, 0.0), (-0.9, 0.9)) + PSign(name))
    for name, (x, y) in sorted(DOCKS.items()):
        hall += TPlace(x, y)(PDock((0.0, 0.0), (-0.8, 0.8)) + TPlace(-0.8, 1.5)(PSign(name)))
    ids = tuple(f"carrier{n + 1}" for n in range(options["carriers"]))
    homes = [AISLE + 1.5 * (n + 1) for n in range(len(ids))]
    for y in homes:
        hall += TPlace(HOME, y)(PCharger(0.6))
    manager = Manager("manager", carriers=ids).string
    return sum(
        (Carrier(id, x=HOME, y=y, home=y).string for id, y in zip(ids, homes, strict=True)),
        hall + manager,
    )
