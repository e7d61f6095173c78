"""A person's hands: from clicks and keys to deeds, whatever world it is.

Pure: it knows what is selected and what the world takes orders for, and does nothing itself.
"""

from __future__ import annotations

from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.picture import Picture
from minerva_bus.world.operator import WorldStatus
from minerva_services.views.window.deeds import Deed, Nudge, Order, Pause, Resume, Settings, Step
from minerva_services.views.window.keys import KEYS, Action
from minerva_services.views.window.picking import Hit, someone
from minerva_services.views.window.roles import Roles, roles_of


class Hands:
    """What is selected, and what follows from the next click or key.

    `click` and `slide` name event types to send, where those that the world offers are not meant.
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
        self.paused = False
        self._vocabulary = vocabulary
        self._names = click, slide
        self._settings = Settings()
        self.roles = Roles()
        self._orders: tuple[str, ...] | None = None

    def know(self, status: WorldStatus) -> None:
        """Learn how the world is doing."""
        self.paused = status.paused
        if status.orders != self._orders:
            self._orders = status.orders
            self.roles = roles_of(self._vocabulary, status.orders, *self._names)

    def click(self, hit: Hit | None, *, double: bool = False) -> Deed | None:
        """A click: on an agent selects it, twice follows it; on a label sends its text."""
        if hit is None:
            return None
        if hit.agent:
            self.selected, self.follows = hit.agent, double
            return None
        event = self.roles.click
        if event is None:
            return None
        return Order(event(hit.label, receivers=self._receivers))

    def click_aside(self, hit: Hit | None) -> Deed | None:
        """A click with the other button: on one label, then on another, sends both."""
        event = self.roles.pair
        if hit is None or not hit.label or event is None:
            self.source = ""
            return None
        if not self.source:
            self.source = hit.label
            return None
        source, self.source = self.source, ""
        return Order(event(source, hit.label, receivers=self._receivers))

    def press(self, action: Action, picture: Picture) -> Deed | None:
        """A key."""
        if action is Action.PAUSE:
            self.paused = not self.paused
            return Pause() if self.paused else Resume()
        if action is Action.STEP:
            self.paused = True
            return Step()
        if action in (Action.MORE, Action.LESS):
            return self._nudge(1 if action is Action.MORE else -1, picture)
        if action is Action.FOLLOW:
            self.selected = self.selected or someone(picture)
            self.follows = bool(self.selected) and not self.follows
        elif action is Action.DESELECT:
            self.selected = self.source = ""
            self.follows = self.helps = False
        elif action is Action.HELP:
            self.helps = not self.helps
        elif action is Action.BEAMS:
            self.beams = not self.beams
        return None

    def let_go(self) -> None:
        """The picture was moved by hand: it follows nobody."""
        self.follows = False

    @property
    def help(self) -> tuple[tuple[str, str], ...]:
        """Keys, what they do, and what clicks do in this world."""
        slide, click, pair = self.roles.slide, self.roles.click, self.roles.pair
        meanings = {one: one.value for one in KEYS}
        if slide is not None:
            datum = slide.fields.names[0]
            meanings[Action.MORE] = f"{slide.name}: more {datum}"
            meanings[Action.LESS] = f"{slide.name}: less {datum}"
        else:
            del meanings[Action.MORE], meanings[Action.LESS]
        lines = [(" ".join(KEYS[one][:2]), meaning) for one, meaning in meanings.items()]
        lines += [("wheel, drag", "zoom, move"), ("click an agent", "select; twice: follow")]
        lines += [("click a label", f"{click.name}")] if click is not None else []
        lines += [("right-click two labels", pair.name)] if pair is not None else []
        return tuple(lines)

    @property
    def doing(self) -> str:
        """What is selected and what a click will mean now; "" where there is nothing to say."""
        said = [self.selected] if self.selected else []
        said += ["followed"] if self.follows else []
        if self.source and self.roles.pair is not None:
            said.append(f"{self.roles.pair.name} from {self.source}: right-click where to")
        return ", ".join(said)

    @property
    def _receivers(self) -> tuple[str, ...]:
        return (self.selected,) if self.selected else ()

    def _nudge(self, steps: int, picture: Picture) -> Deed | None:
        event = self.roles.slide
        if event is None:
            return None
        like = self.selected or someone(picture)
        return Nudge(event, steps, like, self._receivers, self._vocabulary, self._settings)
