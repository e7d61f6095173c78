"""Collisions: who touches whom, found by running the view in a geometry of bounding volumes.

"The event generator of this type would calculate the collisions between elements by extracting the
scene geometry ... Then, it would generate the events needed to react to such collisions" (section
5). It moves nobody: what a collision does to an agent is up to the agent's λ.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.semantics.volumes import Bodies, Texts, Volumes
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.physics.colliding import Teller
from minerva_services.physics.collisions.contacts import ANYTHING, Owners, Pair, contacts
from minerva_services.physics.collisions.memory import Contact, Memory
from minerva_services.physics.collisions.touching import Touches


class Collisions(Device, Generator, coupled=True):
    """Looks at what agents and scenery occupy, and tells each, in the next frame, what it touches.

    The view is what can be touched: discs, lines as wide as they are, and the cells of matrices
    that have a height. What agents show in it is theirs; in populations, and where agents are in
    the scope of others, figures carry the agent's id, `PBody(who=self.id)`.

    Two agents that touch are told both, each in its own words; agents whose kind does not subscribe
    to the event type hear nothing. Of several things touched, scenery comes first, and then agents
    in the order of the string. For the data see `minerva_services.physics.colliding`.

    Args:
        event: the type of what agents are told.
        draws: the visual event type of the views.
        every: frames from one view to the next. With 1 agents hear in each frame where they were
            one frame ago; with 2 they look in one frame and move in the next.
        persist: tell a collision in each view in which it lasts, and not only when it begins.
        ignore: pairs that do not count, each a list of two kinds of agents or primitives; `*` is
            anything.
        who: the name of the agent's id in the view.

    """

    def __init__(
        self,
        event: str = "eCollision",
        draws: str = "eBody",
        every: int = 1,
        persist: bool = False,
        ignore: tuple[Any, ...] = (),
        who: str = "who",
    ) -> None:
        if every < 1:
            raise MisuseError(f"collisions: every is {every}; expected a number of frames from 1")
        self.every = every
        self.draws = (draws,)
        self._event = event
        self._persist = persist
        self._ignored = _pairs(ignore)
        self._who = who
        self._memory = Memory()
        self._count = 0
        self._shown: int | None = None

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        self._teller = Teller("collisions", world, self._event)
        self._bodies = Bodies(world.vocabulary, self._who)
        _check_known(self._ignored, world)

    def show(self, view: View) -> None:
        """Reckon at once, while the others are still at the frame that shows this."""
        try:
            self._volumes = self._bodies.volumes(view.skeleton, view.parts)
        except MisuseError as error:
            raise MisuseError(f"collisions: {error}") from None
        self._owners = Owners.among(self._volumes)
        self._found = contacts(self._volumes, self._owners, self._ignored)
        self._shown = view.frame

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        if self._shown is None or self._shown != tick.number - 1:
            return ()
        found, begins = self._since()
        if not len(found.one):
            return ()
        owners, volumes = self._volumes.owners, self._volumes
        receivers = Ids.of(owners[found.one].tolist())
        return (self._teller.many(_data(volumes, found, begins), receivers),)

    def save(self) -> Mapping[str, Any]:
        """What touches, which the next view does not tell."""
        return {"touching": self._memory.save(), "count": self._count}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from there. Raises MisuseError where the value is not what `save` returns."""
        try:
            self._memory = Memory.restored(saved["touching"])
            self._count = int(saved["count"])
        except (KeyError, TypeError, ValueError) as error:
            raise MisuseError(f"collisions: not a saved state: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """How many collisions have begun; that of two agents is one."""
        return {"collisions": self._count}

    def _since(self) -> tuple[Touches, np.ndarray[Any, np.dtype[np.bool_]]]:
        """The contacts to tell, and which of them begin."""
        found, owners = self._found, self._volumes.owners
        several = zip(
            owners[found.one].tolist(),
            owners[found.other].tolist(),
            *found.normal.T.tolist(),
            strict=True,
        )
        now = [Contact(*one) for one in several]
        begins = np.array([not self._memory.knows(one) for one in now], np.bool_)
        self._memory = Memory(now)
        begun = [one for one, new in zip(now, begins.tolist(), strict=True) if new]
        self._count += sum(not one.other or one.agent < one.other for one in begun)
        if self._persist:
            return found, begins
        told = np.flatnonzero(begins)
        return found.take(told), begins[told]


def _check_known(ignored: Iterable[Pair], world: WorldInfo) -> None:
    """Refuse names that nothing can have. Raises MisuseError."""
    known = {ANYTHING, *world.vocabulary.kinds, *world.vocabulary.primitives}
    for name in (name for pair in ignored for name in pair):
        if name not in known:
            raise MisuseError(
                f"collisions: ignore has {name}, which is no kind of agents and no primitive of"
                f" the world {world.world!r}{nearest(name, sorted(known))}"
            )


def _data(volumes: Volumes, found: Touches, begins: Any) -> Mapping[str, Any]:
    """All that can be told, in columns."""
    others: Texts = volumes.owners[found.other]
    return {
        "shortfall": 0.0,
        "other": others,
        "what": volumes.symbols[found.other],
        "x": found.point[:, 0],
        "y": found.point[:, 1],
        "nx": found.normal[:, 0],
        "ny": found.normal[:, 1],
        "depth": found.depth,
        "begins": begins,
    }


def _pairs(ignore: Iterable[Any]) -> tuple[Pair, ...]:
    """The pairs of an option. Raises MisuseError."""
    found: list[Pair] = []
    for one in [ignore] if isinstance(ignore, str) else ignore:
        names = list(one) if isinstance(one, list | tuple) else [one]
        if len(names) != 2 or not all(isinstance(name, str) for name in names):
            raise MisuseError(
                f"collisions: ignore has {one!r}; expected pairs of kinds of agents or primitives,"
                ' [["ACar", "ACar"], ["AGhost", "*"]]'
            )
        found.append((names[0], names[1]))
    return tuple(found)
