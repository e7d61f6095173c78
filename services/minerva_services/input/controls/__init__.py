"""Bindings of keys and buttons to events of a world."""

from minerva_services.input.controls.control_map import (
    Binding,
    ControlMap,
    InputRange,
    bindings,
    choices,
)

__all__ = ["Binding", "ControlMap", "InputRange", "bindings", "choices"]
