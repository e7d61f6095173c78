"""A gamepad's stick and buttons, as orders to a world."""

from minerva_services.input.gamepad.service import Gamepad

__all__ = ["Gamepad"]
