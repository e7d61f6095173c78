"""Collision detection: contacts between agents and scenery, from bounding volumes of the view.

"The event generator of this type would calculate the collisions between elements by extracting the
scene geometry ... Then, it would generate the events needed to react to such collisions" (section
5). It moves nothing: the effect of a collision on an agent is up to the agent's λ.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.services import Device, Generator, Tick, View, WorldInfo
from minerva_services.geometry.volumes import Bodies, Texts, Volumes
from minerva_services.options import check_owner
from minerva_services.physics.agent_lines import AGENTS, agent_lines, by_agent
from minerva_services.physics.collision_events import CollisionEvents
from minerva_services.physics.collisions.contacts import ANYTHING, Pair, Touches, contacts

_SAME_COSINE: Final = 0.7
"""Cosine of the angle (about 45 degrees) within which two touches of scenery count as the same."""


@dataclass(frozen=True, slots=True)
class ContactPair:
    """An agent touches another, or scenery (""); the unit normal points to the agent."""

    agent: str
    other: str
    nx: float
    ny: float


class ContactMemory:
    """Current contacts. Several touches of scenery by one agent are told apart by direction."""

    def __init__(self, contacts: Sequence[ContactPair] = ()) -> None:
        self._known: dict[tuple[str, str], list[ContactPair]] = {}
        for contact in contacts:
            self._known.setdefault((contact.agent, contact.other), []).append(contact)

    def knows(self, contact: ContactPair) -> bool:
        """True if the contact existed in the previous view."""
        # Two agents have one contact, whose normal turns while they move around each other. Scenery
        # may be touched on several sides, so there the direction tells old contacts from new ones.
        known = self._known.get((contact.agent, contact.other), [])
        if contact.other:
            return bool(known)
        return any(contact.nx * other.nx + contact.ny * other.ny >= _SAME_COSINE for other in known)

    def save(self) -> str:
        """All contacts by agent, in a text: so many plain values would be too many."""
        lists: dict[str, list[list[Any]]] = {}
        for contact in (contact for known in self._known.values() for contact in known):
            lists.setdefault(contact.agent, []).append([contact.other, contact.nx, contact.ny])
        # As JSON, because a figure may name any text as its owner.
        return agent_lines({agent: json.dumps(each) for agent, each in lists.items()})

    @staticmethod
    def restored(saved: str) -> ContactMemory:
        """Inverse of `save`. Raises TypeError and ValueError for other values."""
        return ContactMemory(
            [
                ContactPair(agent, str(other), float(nx), float(ny))
                for agent, text in by_agent(saved).items()
                for other, nx, ny in json.loads(text)
            ]
        )


class Collisions(Device, Generator, coupled=True):
    """Detects contacts in views, and notifies each agent in the next frame.

    The view shows what can be touched: discs, lines with their width, and the cells of matrices
    that have a height. What an agent shows belongs to it; in populations, and where agents are in
    the scope of others, figures carry the agent's id, `PBody(who=self.id)`.

    Both agents of a pair are notified, each from its own point of view; agents whose kind does not
    subscribe to the event type receive nothing. Several contacts of one agent are ordered: scenery
    first, then agents in the order of the string. For the data see
    `minerva_services.physics.collision_events`.

    Args:
        event: the event type of notifications.
        draws: the visual event type of the views.
        every: frames between views. With 1, agents receive contacts of the previous frame; with 2
          they look in one frame and move in the next.
        persist: notify in each view while a contact lasts, not only when it begins.
        ignore: pairs to skip, each a list of two agent kinds or primitives; `*` matches anything.
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
        self.when = f"each {every} frames"
        self.draws = (draws,)
        self._event = event
        self._persist = persist
        self._ignored = _pairs(ignore)
        self._who = who
        self._memory = ContactMemory()
        self._count = 0
        self._shown: int | None = None

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def check(self, world: WorldInfo) -> None:
        check_owner("collisions", world, self._who)
        self._collision_events = CollisionEvents("collisions", world, self._event)
        self._bodies = Bodies(world.vocabulary, self._who)
        _check_known(self._ignored, world)

    def show(self, view: View) -> None:
        """Compute immediately, in parallel with the members that still work on this frame."""
        try:
            self._volumes = self._bodies.volumes(view.skeleton, view.parts)
        except MisuseError as error:
            raise MisuseError(f"collisions: {error}") from None
        self._touches = contacts(self._volumes, self._ignored)
        self._shown = view.frame

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        # With `every` > 1 most frames follow no view; contacts of an older view have been reported.
        if self._shown is None or self._shown != tick.number - 1:
            return ()
        touches, begins = self._since()
        if not len(touches.first):
            return ()
        owners, volumes = self._volumes.owners, self._volumes
        receivers = Ids.of(owners[touches.first].tolist())
        return (self._collision_events.events(_data(volumes, touches, begins), receivers),)

    def save(self) -> Mapping[str, Any]:
        """The current contacts, which the next view does not contain."""
        return {AGENTS: self._memory.save(), "count": self._count}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state. Raises MisuseError for other values."""
        try:
            self._memory = ContactMemory.restored(saved[AGENTS])
            self._count = int(saved["count"])
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise MisuseError(f"collisions: not a saved state: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Number of collisions that began; a pair of agents counts once."""
        return {"collisions": self._count}

    def _since(self) -> tuple[Touches, np.ndarray[Any, np.dtype[np.bool_]]]:
        """The contacts to report, and which of them begin."""
        touches, owners = self._touches, self._volumes.owners
        now = [
            ContactPair(agent, other, nx, ny)
            for agent, other, (nx, ny) in zip(
                owners[touches.first].tolist(),
                owners[touches.second].tolist(),
                touches.normal.tolist(),
                strict=True,
            )
        ]
        begins = np.array([not self._memory.knows(contact) for contact in now], np.bool_)
        # Only `generate` updates the memory. A successor receives the last view again, and `show`
        # must not take the contacts of that view for known ones.
        self._memory = ContactMemory(now)
        new = [contact for contact, begin in zip(now, begins.tolist(), strict=True) if begin]
        # Each agent of a pair has a contact of its own; the one with the smaller id counts for
        # both.
        self._count += sum(not contact.other or contact.agent < contact.other for contact in new)
        if self._persist:
            return touches, begins
        new_rows = np.flatnonzero(begins)
        return touches.take(new_rows), begins[new_rows]


def _check_known(ignored: Iterable[Pair], world: WorldInfo) -> None:
    """Check that all names exist. Raises MisuseError."""
    known = {ANYTHING, *world.vocabulary.kinds, *world.vocabulary.primitives}
    for name in (name for pair in ignored for name in pair):
        if name not in known:
            raise MisuseError(
                f"collisions: ignore has {name}, which is neither an agent kind nor a primitive of"
                f" the world {world.world!r}{nearest(name, sorted(known))}"
            )


def _data(volumes: Volumes, touches: Touches, begins: Any) -> Mapping[str, Any]:
    """All available data, as columns."""
    others: Texts = volumes.owners[touches.second]
    return {
        "shortfall": 0.0,
        "other": others,
        "what": volumes.symbols[touches.second],
        "x": touches.point[:, 0],
        "y": touches.point[:, 1],
        "nx": touches.normal[:, 0],
        "ny": touches.normal[:, 1],
        "depth": touches.depth,
        "begins": begins,
    }


def _pairs(ignore: Iterable[Any]) -> tuple[Pair, ...]:
    """The pairs of the option `ignore`. Raises MisuseError."""
    pairs: list[Pair] = []
    # A text is iterable, too: a single name must be rejected as a whole, not letter by letter.
    for entry in [ignore] if isinstance(ignore, str) else ignore:
        names = list(entry) if isinstance(entry, list | tuple) else [entry]
        if len(names) != 2 or not all(isinstance(name, str) for name in names):
            raise MisuseError(
                f"collisions: ignore has {entry!r}; expected pairs of agent kinds or primitives,"
                ' [["ACar", "ACar"], ["AGhost", "*"]]'
            )
        pairs.append((names[0], names[1]))
    return tuple(pairs)
