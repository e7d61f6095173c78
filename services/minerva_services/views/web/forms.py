"""An input form for an order type, derived from its declared data."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from viser import GuiApi, GuiDropdownHandle, GuiEvent, GuiSliderHandle

from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.symbols import EventType
from minerva_services.views.web.orders import kinds_of_data, title

_RANGES = {
    "m/s": (0.0, 2.0, 0.05),
    "m": (0.0, 10.0, 0.1),
    "deg": (-180.0, 180.0, 1.0),
    "s": (0.0, 60.0, 0.5),
}
"""Minimum, maximum and step of a slider by unit."""

Send = Callable[[str, Mapping[str, Any]], None]


def by_person(event: GuiEvent[Any]) -> bool:
    """True if a user changed an input, rather than this program."""
    return event.client_id is not None


class Form:
    """Inputs for the data of one event type; a single real with a known range is a slider.

    `send` is called when the button is pressed, `slide` whenever the slider moves.
    """

    def __init__(
        self, gui: GuiApi, declared: EventType, labels: tuple[str, ...], send: Send, slide: Send
    ) -> None:
        self._gui = gui
        self._type = declared.name
        self._labels = labels
        self._send = send
        self._slide = slide
        self._slider: GuiSliderHandle[float] | None = None
        self._inputs: dict[str, Any] = {}
        self._lock = threading.Lock()
        fields = declared.fields.all
        # A slider sends while it moves, so it needs no button.
        if kinds_of_data(declared) == ("real",) and fields[0].type.unit in _RANGES:
            self._add_slider(fields[0])
            return
        for field in fields:
            self._inputs[field.name] = self._input(field)
        self._button = gui.add_button(f"Send {declared.name}")
        self._button.on_click(lambda _: send(declared.name, self.data()))

    def data(self) -> dict[str, Any]:
        """The values entered."""
        return {name: widget.value for name, widget in self._inputs.items()}

    def outgrown(self, labels: tuple[str, ...]) -> bool:
        """True if its text inputs could now be selections of labels."""
        return bool(labels) and not self._labels

    def offer(self, labels: tuple[str, ...]) -> None:
        """Offer these labels for text inputs."""
        if labels == self._labels or not labels:
            return
        self._labels = labels
        for widget in self._inputs.values():
            if isinstance(widget, GuiDropdownHandle):
                widget.options = labels

    def update(self, state: Mapping[str, Any]) -> None:
        """Move the slider to the value in the agent's state."""
        if self._slider is None:
            return
        (name,) = self._inputs
        value = state.get(name)
        if isinstance(value, float):
            # The range first, because the value must lie within it.
            self._slider.max = max(self._slider.max, value)
            self._slider.min = min(self._slider.min, value)
            self._slider.value = value

    def remove(self) -> None:
        """Remove the form from the page."""
        for widget in self._inputs.values():
            widget.remove()
        if self._slider is None:
            self._button.remove()

    def _input(self, field: Field) -> Any:
        gui, name, kind, given = self._gui, title(field), field.type.kind, field.default
        if kind == "bool":
            return gui.add_checkbox(name, bool(given))
        if kind == "text" and self._labels:
            # Inputs start with different labels, because an order with the same label as source and
            # target makes no sense.
            next_one = self._labels[len(self._inputs) % len(self._labels)]
            known = str(given) if given in self._labels else next_one
            return gui.add_dropdown(name, self._labels, initial_value=known)
        if kind == "text":
            return gui.add_text(name, given if isinstance(given, str) else "")
        number = given if isinstance(given, int | float) else 0
        if kind == "int":
            return gui.add_number(name, int(number), step=1)
        return gui.add_number(name, float(number), step=0.01)

    def _add_slider(self, field: Field) -> None:
        least, most, step = _RANGES[field.type.unit]
        value = field.default if isinstance(field.default, float) else max(least, 0.0)
        self._slider = self._gui.add_slider(
            title(field), min(least, value), max(most, value), step, value
        )
        self._inputs[field.name] = self._slider

        @self._slider.on_update
        def _(event: GuiEvent[Any]) -> None:
            if by_person(event):
                self._slide(self._type, self.data())
