"""Cases of devices: key views, deltas, gaps, and coupled devices."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.grammar.columns import difference, packed
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_conformance.case import Deliver, Tier
from minerva_conformance.cases.scripts import (
    ANY_DEVICE,
    COUPLED,
    END,
    GREET,
    OBSERVER,
    PART,
    CaseGroup,
    delta_view,
    key_view,
    tick,
    ticks,
)
from minerva_conformance.world import PBar

_case: Final = CaseGroup(roles=ANY_DEVICE, ending=END).case


def _bars(count: int, *longer: int) -> Scene:
    """Bars of growing lengths, those of some rows longer by 8."""
    scene = Scene()
    for number in range(count):
        scene = scene + PBar(0.25 * number + (8.0 if number in longer else 0.0))
    return scene


_STATIC: Final = Deliver(
    m.ViewShown(
        "eShow", 2, 1, {"a": PBar(2.0)},
        skeleton=Scene((*PBar(8.0).pieces, AgentNode("ACounter", "a"), *PBar(16.0).pieces)),
    )
)  # fmt: skip
_PART_VIEW: Final = Deliver(
    m.ViewShown(
        "eShow", 0, 1, {PART: _bars(40), "a": PBar(100.0)},
        skeleton=Scene((AgentNode("ACounter", PART), AgentNode("ACounter", "a"))),
    )
)  # fmt: skip

_COLUMNS: Final = tuple(
    [packed(_bars(40, *longer)) for longer in ((), (3, 7), (7, *range(20, 40)))]
)
_COLUMNS_VIEW: Final = Deliver(
    m.ViewShown("eShow", 0, 1, {PART: _COLUMNS[0]}, skeleton=Scene((AgentNode("ACounter", PART),)))
)


def _patch_view(frame: int) -> Deliver:
    """A delta with a patch of the part."""
    patch = difference(_COLUMNS[frame - 1].pieces[0], _COLUMNS[frame].pieces[0])
    assert patch is not None
    return Deliver(m.ViewShown("eShow", frame, frame + 1, {PART: patch}))


_DRAWN: Final = (
    _case("draw.key", "draws a key view", "P10.1 P10.2", key_view(3, 1, a=1.0, b=2.5)),
    _case("draw.empty", "draws an empty view", "P10.1 P10.2 P8.6", key_view(3, 1)),
    _case(
        "draw.delta", "replaces the parts of a delta", "P10.3",
        key_view(0, 1, a=1.0, b=2.5), delta_view(1, 2, b=4.0), delta_view(2, 3, a=0.5),
    ),
    _case(
        "draw.vanished", "draws nothing for an empty part", "P10.1 P10.3",
        key_view(0, 1, a=1.0, b=2.5), delta_view(1, 2, a=None),
    ),
    _case(
        "draw.missing", "draws nothing for a slot without a part", "P10.1",
        Deliver(m.ViewShown("eShow", 4, 1, {"a": PBar(2.0)}, skeleton=Scene(
            (AgentNode("ACounter", "a"), AgentNode("ACounter", "b"))))),
    ),
    _case("draw.static", "draws the static parts of a skeleton", "P10.1", _STATIC),
    _case(
        "draw.key again", "discards everything for a key view", "P10.2",
        key_view(0, 1, a=1.0, b=2.5), key_view(1, 2, c=7.0),
    ),
    _case(
        "draw.key without part", "draws nothing for a slot that a key view leaves out", "P10.2",
        key_view(0, 1, a=1.0, b=2.5),
        Deliver(m.ViewShown("eShow", 1, 2, {"b": PBar(2.0)}, skeleton=Scene(
            (AgentNode("ACounter", "a"), AgentNode("ACounter", "b"))))),
    ),
    _case(
        "draw.empty delta", "accepts a delta without changes", "P10.3",
        key_view(0, 1, a=1.0), delta_view(1, 2), delta_view(2, 3, a=2.0),
    ),
    _case(
        "draw.halted", "draws a view with halted agents", "P8.1",
        Deliver(m.ViewShown("eShow", 3, 1, {"a": PBar(2.0)}, skeleton=Scene(
            (AgentNode("ACounter", "a"),)), halted=("a",))),
    ),
    _case(
        "draw.part", "draws a part of a population", "P10.1 P9.22",
        _PART_VIEW, delta_view(1, 2, a=50.0),
    ),
    _case(
        "draw.patch", "applies patches of a part's view", "P10.3 P3.20",
        _COLUMNS_VIEW, _patch_view(1), _patch_view(2), requires="columns", tier=Tier.EXACT,
    ),
    _case(
        "draw.first", "accepts a first key view of any frame and sequence", "P10.4",
        key_view(900, 31, a=1.0), delta_view(901, 32, a=2.0),
    ),
    _case(
        "draw.repeated key", "accepts a key view of the same sequence", "P10.4",
        key_view(0, 3, a=1.0), key_view(0, 3, a=2.0), delta_view(1, 4, b=1.0),
        tier=Tier.EXACT,
    ),
    _case(
        "draw.older key", "ignores a key view of a lower sequence", "P10.4",
        key_view(5, 3, a=1.0), key_view(4, 2, a=2.0), delta_view(6, 4, a=4.0),
        tier=Tier.EXACT,
    ),
    _case(
        "draw.older delta", "ignores a delta that it has had", "P10.4",
        key_view(0, 3, a=1.0), delta_view(1, 4, a=2.0), delta_view(1, 4, a=3.0),
        delta_view(0, 2, a=5.0), tier=Tier.EXACT,
    ),
    _case(
        "draw.gap", "asks for a key view after a gap", "P10.5",
        key_view(0, 1, a=1.0), delta_view(2, 3, a=2.0), key_view(2, 3, a=2.0),
        delta_view(3, 4, a=8.0),
    ),
    _case(
        "draw.no key", "asks for a key view if it has had none", "P10.5",
        delta_view(2, 3, a=2.0), key_view(2, 3, a=2.0), delta_view(3, 4, a=8.0),
    ),
    _case(
        "draw.gap kept", "does not apply a delta after a gap", "P10.5 P10.4",
        key_view(0, 1, a=1.0), delta_view(2, 3, a=2.0), tier=Tier.EXACT,
    ),
    _case(
        "draw.greeted", "keeps its views when it is greeted again", "P6.6",
        key_view(0, 1, a=1.0), GREET, delta_view(1, 2, a=2.0), tier=Tier.ROBUST,
    ),
    _case(
        "draw.many", "draws a thousand parts", "P10.1 P10.2",
        key_view(0, 1, **{f"n{n}": n / 4 for n in range(1000)}), delta_view(1, 2, n7=100.0),
        tier=Tier.ROBUST,
    ),
    _case(
        "draw.large frame", "reads a large frame exactly", "P3.1",
        key_view((1 << 53) + 1, (1 << 53) + 1, a=1.0),
        delta_view((1 << 53) + 2, (1 << 53) + 2, a=2.0), tier=Tier.EXACT,
    ),
)  # fmt: skip

_COUPLED: Final = (
    _case(
        "coupled.tick", "answers ticks without events", "P8.3 P10.6",
        key_view(0, 1, a=1.0), tick(1), delta_view(1, 2, a=2.0), tick(2), roles=COUPLED,
    ),
    _case(
        "coupled.each", "draws every view", "P10.6 P7.9",
        key_view(0, 1, a=1.0), delta_view(1, 2, a=2.0), delta_view(2, 3, a=3.0), tick(3),
        roles=COUPLED,
    ),
    _case(
        "coupled.repeated", "repeats the answer to a repeated tick", "P7.5",
        key_view(0, 1, a=1.0), tick(1), tick(1), tick(2), roles=COUPLED,
    ),
    _case("coupled.no view", "answers a tick without a view", "P8.3", *ticks(0, 1), roles=COUPLED),
)  # fmt: skip

_OBSERVERS: Final = (
    _case(
        "observer.to",
        "draws a key view on its own key",
        "P10.5 P10.7",
        key_view(0, 1, a=1.0),
        Deliver(key_view(1, 2, a=3.0).message, "to"),
        roles=OBSERVER,
    ),
)

DEVICES: Final = (*_DRAWN, *_COUPLED, *_OBSERVERS)
