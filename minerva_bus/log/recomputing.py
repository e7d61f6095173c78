"""Running λ again over what was recorded: `minerva replay FILE --recompute`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.frame.enforcement import Enforcement, Ruling
from minerva_bus.frame.hosting import Host
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.comparison import Difference, apart, same_events
from minerva_bus.log.errors import RecordError
from minerva_bus.log.reader import Record
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy
from minerva_bus.world.kinds import Kinds

SIDES = ("the record", "this run")
_HERE = "~again"


class _Again:
    """A world whose agents live through given events."""

    def __init__(self, world: World, kinds: Kinds) -> None:
        self._world = world
        literal = world.policy is Policy.LITERAL
        self.composition = Composition(world.scene, columns=not literal)
        self._host = Host(_HERE, kinds)
        self._enforcement = Enforcement(world.norms, self.composition, world.vocabulary, {})

    def live(self, number: int, events: Sequence[AnyEvent]) -> list[AnyEvent]:
        """η of a frame; the events that agents have sent, in order. Raises ActivityError."""
        world, host, composition = self._world, self._host, self.composition
        evolving = tuple(e for e in events if not world.vocabulary.events[e.type].visual)
        host.fragments = dict(composition.fragments)
        request = m.EvolveRequest(number, (_HERE,), evolving)
        changed, emitted = self._answer(request)
        ruling = Ruling(dict(changed), dict(emitted))
        trial = self._enforcement.agents(number, changed, emitted)
        if trial is not None:
            for fewer in self._enforcement.stages(trial, evolving):
                host.fragments = dict(composition.fragments)
                request = m.EvolveRequest(number, (_HERE,), fewer, only=trial.open)
                self._enforcement.reconsider(trial, *self._answer(request))
            ruling = self._enforcement.ruling(trial)
        places = composition.places(ruling.sent)
        sent = [one for name in sorted(ruling.sent, key=places) for one in ruling.sent[name]]
        composition.replace(ruling.changed)
        return sent

    def _answer(self, request: m.EvolveRequest) -> tuple[m.Parts, m.SentBy]:
        """What becomes of fragments, and what their agents send."""
        world, host = self._world, self._host
        moment = Frame(request.frame, world.dt, world.seed)
        reply = host.answer(request, moment, world.policy, world.vocabulary)
        patched = {one: Scene((host.fragments[one],)) for one in reply.patched}
        return {**reply.changed, **patched}, reply.emitted


def recompute(record: Record, kinds: Kinds, done: Callable[[int], None]) -> Difference:
    """Run λ again on each frame's recorded events, up to the first frame that differs.

    Compared are the digests, and the events that agents send. `done` is told how many frames are.
    Raises RecordError, and ActivityError where user code raised.
    """
    again = _Again(record.description.world, kinds)
    count = 0
    for frame, emitted in record.emitted():
        if frame.number != count:
            raise RecordError(f"{record.path}: frame {count} is not in it, so λ cannot go on")
        sent = again.live(frame.number, frame.events)
        scene = again.composition.scene
        other = emitted is not None and not same_events(emitted, sent)
        if scene.digest != frame.digest or other:
            strings = record.string(frame.number + 1), scene
            return apart(
                record.description.world.vocabulary, frame, strings, (emitted or (), sent), SIDES
            )
        count += 1
        done(count)
    return Difference(None, count)
