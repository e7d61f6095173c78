"""Key bindings; the help in the window is generated from this table."""

from __future__ import annotations

from enum import Enum


class Action(Enum):
    """Meanings of keys."""

    PAUSE = "pause, go on"
    STEP = "one frame"
    MORE = "more"
    LESS = "less"
    FOLLOW = "follow the selected agent"
    DESELECT = "select nobody"
    FIT = "show the whole world"
    BEAMS = "laser beams"
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
    Action.HELP: ("h", "f1"),
}
_ACTIONS = {key: action for action, keys in KEYS.items() for key in keys}


def action_of(key: str) -> Action | None:
    """The action of a key, by pygame's name."""
    return _ACTIONS.get(key.lower())
