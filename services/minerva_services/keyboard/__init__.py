"""A terminal's keys, as orders to a world."""

from minerva_services.keyboard.service import Keyboard

__all__ = ["Keyboard"]
