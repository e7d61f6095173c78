"""Bindings of keys and buttons to events of a world."""

from minerva_services.input.controls.binding import Binding, bindings, choices
from minerva_services.input.controls.control_map import ControlMap, InputRange

__all__ = ["Binding", "ControlMap", "InputRange", "bindings", "choices"]
