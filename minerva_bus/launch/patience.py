"""How long a frame waits for members, and what then, as a world file says it."""

from __future__ import annotations

from minerva_bus.launch.table import Table
from minerva_bus.runtime.waiting import THEN, Patience

KEYS = ("soft", "hard", "late")


def read_patience(table: Table, plain: Patience) -> Patience:
    """What `soft` and `hard`, in seconds, and `late` say; `plain` is what is not said.

    Raises WorldFileError.
    """
    others = [one for one in THEN if one != plain.then]
    patience = Patience(
        table.number("soft", plain.soft, 0.05),
        table.number("hard", plain.hard, 0.1),
        table.choice("late", (plain.then, *others)),
    )
    if patience.soft > patience.hard:
        table.wrong("soft", f"must not be over hard, {patience.hard:g}")
    return patience
