"""Controls: translate clicks and keys to actions, in any world.

Pure: knows the selection and the world's order types, and performs nothing itself.
"""

from __future__ import annotations

from enum import Enum

from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import WorldStatus
from minerva_services.geometry.picture import Picture
from minerva_services.views.window.actions import (
    AdjustAction,
    OrderAction,
    PauseAction,
    ResumeAction,
    SentNumbers,
    StepAction,
    WorldAction,
)
from minerva_services.views.window.order_types import OrderTypes, order_types
from minerva_services.views.window.picking import Hit, first_agent


class Action(Enum):
    """Meanings of keys."""

    PAUSE = "pause or resume"
    STEP = "one frame"
    MORE = "more"
    LESS = "less"
    FOLLOW = "follow the selected agent"
    DESELECT = "select nobody"
    FIT = "show the whole world"
    BEAMS = "laser beams"
    LEGEND = "legend"
    ORDERS = "orders of people"
    HELP = "this help"


KEYS: dict[Action, tuple[str, ...]] = {
    Action.PAUSE: ("space",),
    Action.STEP: ("n", "."),
    Action.MORE: ("up", "+", "=", "[+]"),
    Action.LESS: ("down", "-", "[-]"),
    Action.FOLLOW: ("f",),
    Action.DESELECT: ("escape",),
    Action.FIT: ("0", "home", "[0]"),
    Action.BEAMS: ("b",),
    Action.LEGEND: ("l",),
    Action.ORDERS: ("o",),
    Action.HELP: ("?", "h", "f1"),
}
_ACTIONS = {key: action for action, keys in KEYS.items() for key in keys}


NUMBERS = tuple("123456789")
"""Keys that send the world's orders without data."""


def action_of(key: str) -> Action | None:
    """The action of a key, by pygame's name."""
    return _ACTIONS.get(key.lower())


class WindowControls:
    """The selection, and the meaning of the next click or key.

    `click` and `slide` name event types to send instead of those found automatically.
    """

    def __init__(
        self, vocabulary: Vocabulary, click: str = "", slide: str = "", follow: str = ""
    ) -> None:
        self.selected = follow
        self.follows = bool(follow)
        self.source = ""
        """The first of two labels."""
        self.helps = False
        self.beams = True
        self.legend = True
        self.orders = True
        self.paused = False
        self._vocabulary = vocabulary
        self._names = click, slide
        self._settings = SentNumbers()
        self.order_types = OrderTypes()
        self._orders: tuple[str, ...] | None = None

    def update(self, status: WorldStatus) -> None:
        """Update from the world's status."""
        self.paused = status.paused
        if status.orders != self._orders:
            self._orders = status.orders
            self.order_types = order_types(self._vocabulary, status.orders, *self._names)

    def click(self, hit: Hit | None, *, double: bool = False) -> WorldAction | None:
        """A click on an agent selects it, a double click follows it.

        A click on a label sends it.
        """
        if hit is None:
            return None
        if hit.agent:
            self.selected, self.follows = hit.agent, double
            return None
        event = self.order_types.click
        if event is None:
            return None
        return OrderAction(event(hit.label, receivers=self._receivers))

    def click_aside(self, hit: Hit | None) -> WorldAction | None:
        """A secondary click on one label, then on another, sends both."""
        event = self.order_types.pair
        if hit is None or not hit.label or event is None:
            self.source = ""
            return None
        if not self.source:
            self.source = hit.label
            return None
        source, self.source = self.source, ""
        return OrderAction(event(source, hit.label, receivers=self._receivers))

    def send_plain(self, key: str) -> WorldAction | None:
        """The order of one of the keys `NUMBERS`, if the world has as many without data."""
        number, plain = NUMBERS.index(key), self.order_types.plain
        if number >= len(plain):
            return None
        return OrderAction(plain[number](receivers=self._receivers))

    def press(self, action: Action, picture: Picture) -> WorldAction | None:
        """Handle a key."""
        if action is Action.PAUSE:
            # Displayed at once; the next status confirms it.
            self.paused = not self.paused
            return PauseAction() if self.paused else ResumeAction()
        if action is Action.STEP:
            self.paused = True
            return StepAction()
        if action in (Action.MORE, Action.LESS):
            return self._adjust(1 if action is Action.MORE else -1, picture)
        if action is Action.FOLLOW:
            self.selected = self.selected or first_agent(picture)
            self.follows = bool(self.selected) and not self.follows
        elif action is Action.DESELECT:
            self.selected = self.source = ""
            self.follows = self.helps = False
        elif action is Action.HELP:
            self.helps = not self.helps
        elif action is Action.BEAMS:
            self.beams = not self.beams
        elif action is Action.LEGEND:
            self.legend = not self.legend
        elif action is Action.ORDERS:
            self.orders = not self.orders
        return None

    def stop_following(self) -> None:
        """The user moved the picture: stop following an agent."""
        self.follows = False

    @property
    def help(self) -> tuple[tuple[str, str], ...]:
        """Keys and clicks with their meanings in this world."""
        slide, click, pair = self.order_types.slide, self.order_types.click, self.order_types.pair
        meanings = {action: action.value for action in KEYS}
        if slide is not None:
            datum = slide.fields.names[0]
            meanings[Action.MORE] = f"{slide.name}: more {datum}"
            meanings[Action.LESS] = f"{slide.name}: less {datum}"
        else:
            del meanings[Action.MORE], meanings[Action.LESS]
        lines = [(" ".join(KEYS[action][:2]), meaning) for action, meaning in meanings.items()]
        plain = zip(NUMBERS, self.order_types.plain, strict=False)
        lines += [(key, event.name) for key, event in plain]
        lines += [("wheel, drag", "zoom, move"), ("click an agent", "select; twice: follow")]
        lines += [("click a label", f"{click.name}")] if click is not None else []
        lines += [("right-click two labels", pair.name)] if pair is not None else []
        return tuple(lines)

    @property
    def doing(self) -> str:
        """The selection and what the next click means; "" if there is nothing to say."""
        parts = [self.selected] if self.selected else []
        parts += ["followed"] if self.follows else []
        if self.source and self.order_types.pair is not None:
            parts.append(
                f"{self.order_types.pair.name} from {self.source}: right-click a destination"
            )
        return ", ".join(parts)

    @property
    def _receivers(self) -> tuple[str, ...]:
        return (self.selected,) if self.selected else ()

    def _adjust(self, steps: int, picture: Picture) -> WorldAction | None:
        event = self.order_types.slide
        if event is None:
            return None
        like = self.selected or first_agent(picture)
        return AdjustAction(event, steps, like, self._receivers, self._vocabulary, self._settings)
