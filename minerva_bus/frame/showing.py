"""Views on their way to devices: deltas in sequence, whole ones for those who come later."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field, replace

from minerva_bus.frame.messages import Parts, Patches, ViewShown
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.fitting import Unfit
from minerva_bus.grammar.patch import check, patched
from minerva_bus.grammar.scene import EMPTY, Scene


@dataclass(slots=True)
class Showing:
    """The views of one visual event type."""

    event_type: str
    sequence: int = 0
    frame: int = -1
    skeleton: Scene = EMPTY
    parts: dict[str, Scene] = field(default_factory=dict[str, Scene])
    halted: tuple[str, ...] = ()

    def next(
        self,
        frame: int,
        skeleton: Scene,
        changed: Parts,
        patches: Patches,
        alive: Container[str],
        halted: tuple[str, ...] = (),
    ) -> ViewShown:
        """The view of a frame: whole where the skeleton is another, else what has changed.

        The agents `halted` carry out nothing of what it shows.
        """
        self.halted = halted
        self.parts.update(changed)
        patch_all(self.parts, patches)
        self.sequence += 1
        self.frame = frame
        if skeleton is not self.skeleton:
            self.skeleton = skeleton
            self.parts = {one: view for one, view in self.parts.items() if one in alive}
            return self.key()
        return ViewShown(
            self.event_type, frame, self.sequence, dict(changed), None, patches, halted
        )

    def unpatched(self, view: ViewShown) -> ViewShown:
        """The view that was made last without patches: what they change is whole."""
        whole = {name: self.parts[name] for name in view.patches}
        return replace(view, parts={**view.parts, **whole}, patches={}) if whole else view

    def key(self) -> ViewShown:
        """The last view as a whole."""
        return ViewShown(
            self.event_type, self.frame, self.sequence, dict(self.parts), self.skeleton,
            halted=self.halted,
        )  # fmt: skip


def patch_all(parts: dict[str, Scene], patches: Patches) -> None:
    """Put patches into the fragments or views of these names. Raises Unfit."""
    for name, patch in patches.items():
        parts[name] = Scene((patched(_columns(parts, name), patch),))


def check_all(parts: Parts, patches: Patches) -> None:
    """Raise Unfit where patches are none of the fragments or views of these names."""
    for name, patch in patches.items():
        check(_columns(parts, name), patch)


def _columns(parts: Parts, name: str) -> Columns:
    old = parts.get(name, EMPTY)
    piece = old.pieces[0] if len(old.pieces) == 1 else None
    if not isinstance(piece, Columns):
        raise Unfit(f"a patch of {name}, which is not in columns")
    return piece
