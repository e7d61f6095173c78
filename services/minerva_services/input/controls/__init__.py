"""What keys and buttons mean to a world: which of its events they give."""

from minerva_services.input.controls.binding import Binding, bindings, choices
from minerva_services.input.controls.wiring import Range, Wiring

__all__ = ["Binding", "Range", "Wiring", "bindings", "choices"]
