"""A belfry: agents of which most show themselves by visual events, and all that may be beside them.

`rings` maps a frame to the events of a generator in step. What a bell does with `eRing` is `act`.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from minerva_bus import (
    EMPTY,
    Agent,
    Context,
    Device,
    Event,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    Transformation,
    View,
    Vocabulary,
    on,
    view,
)
from minerva_bus.frame.description import World

PBell = Primitive("PBell", rung=int)
TGlow = Transformation("TGlow", by=int)
eRing = EventType("eRing", act=str)
eEcho = EventType("eEcho")
eShow = EventType("eShow", visual=True)
eGlow = EventType("eGlow", by=int, visual=True)

ACTS = ("show", "quiet", "twice", "self", "both", "glow", "bear", "die", "echo", "grow")


class Bell(Agent, symbol="ABell"):
    """Sends events as it is told to."""

    rung: int = 0
    births: int = 0

    @on("eRing")
    def ring(self, ring: Event, moment: Context) -> Scene | None:
        self.rung += 1
        if ring.act != "quiet":
            moment.emit(eShow(receivers=[self.id]) if ring.act == "self" else eShow())
        match ring.act:
            case "twice":
                moment.emit(eShow())
            case "glow":
                moment.emit(eGlow(2))
                moment.emit(eShow())
                moment.emit(eGlow(1))
            case "both":
                moment.emit(eEcho())
            case "bear":
                return self.string + self.child(rung=self.rung)
            case "grow":
                self.scope += self.child(rung=self.rung)
            case "die":
                return EMPTY
            case _:
                pass
        return None

    @on("eEcho")
    def listen(self, echo: Event, moment: Context) -> None:
        self.rung += 10

    @view("eShow")
    def show(self, event: Event) -> Scene:
        return PBell(self.rung) + self.scope

    @view("eGlow")
    def glow(self, event: Event) -> Scene:
        return TGlow(event.by)(PBell(self.rung))


class Chime(Agent, symbol="AChime"):
    """Member of a population whose events are a batch."""

    rung: int = 0

    @on("eRing", population=True)
    def ring(self, ring: Any, moment: Any) -> None:
        self.rung += 1
        if ring.act not in ("quiet", "echo"):
            moment.emit(eShow(receivers=self.id), where=self.rung % 2 == 1)

    @on("eEcho", population=True)
    def listen(self, echo: Any, moment: Any) -> None:
        self.rung += 10

    @view("eShow", population=True)
    def show(self, event: Any) -> Scene:
        return PBell(self.rung)


class Ringer(Generator, events=("eRing",)):
    """Sends the events of each frame, as they are written down."""

    def __init__(self, rings: Mapping[int, tuple[Event, ...]]) -> None:
        self.rings = rings

    def generate(self, tick: Tick) -> Iterable[Event]:
        return self.rings.get(tick.number, ())


class Watcher(Device, draws=("eShow", "eGlow")):
    """Keeps each view that it is shown."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def show(self, view: View) -> None:
        self.shown.append(f"{view.frame} {view.event_type}: {view.scene} {sorted(view.halted)}")


VOCABULARY = Vocabulary.of(PBell, TGlow, eRing, eEcho, eShow, eGlow, Bell, Chime)


def belfry(text: str | Scene, expected: Iterable[str], **rest: Any) -> World:
    """A world of bells."""
    string = VOCABULARY.read(text) if isinstance(text, str) else text
    return World("belfry", string, VOCABULARY, expected=frozenset(expected), **rest)
