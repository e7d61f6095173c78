"""A terminal's keys, as orders to a world."""

from minerva_services.input.keyboard.service import Keyboard

__all__ = ["Keyboard"]
