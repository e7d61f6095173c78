"""What a frame's outcome comes to where norms refuse some of it: who is refused goes on by less.

Where what an agent has become is refused, it is asked for what it becomes by fewer of the frame's
events: without those of the last type, without those of the last two, and so on. The first that no
norm refuses counts. So what is lost is the step that leads to what is forbidden, and what would
follow it. What norms send is never left out: at last it is all that the agent lives through.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from minerva_bus.frame.composition import Composition, Fragment
from minerva_bus.frame.outcomes import Elsewhere, Outcome, Sent, outcome_of, state_of
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.rest import rested
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import Norm

SentBy = Mapping[str, tuple[AnyEvent, ...]]
Scenes = Mapping[str, Scene]
Exceeds = Callable[[Norm, str], bool]


@dataclass(frozen=True, slots=True)
class Ruling:
    """What is left of a frame's outcome: what fragments have become, and what agents have sent.

    `overruled` are the fragments that are not what their hosts have made of them, `halted` the
    agents that have been refused a step, sorted: they carry nothing out in this frame.
    """

    changed: dict[str, Scene]
    sent: dict[str, tuple[AnyEvent, ...]]
    overruled: tuple[str, ...] = ()
    halted: tuple[str, ...] = ()


class Trial:
    """The outcome of one frame before the norms; `refused` notes who is, and by which norm."""

    def __init__(
        self, composition: Composition, changed: Scenes, sent: SentBy, elsewhere: Elsewhere
    ) -> None:
        self._composition = composition
        self._changed = dict(changed)
        self._sent = dict(sent)
        self._elsewhere = elsewhere
        places = composition.places(changed)
        self._outcomes = {
            name: outcome_of(composition.fragments[name], changed[name])
            for name in sorted(changed, key=places)
        }
        self._open: dict[str, dict[str, Norm]] = {}
        self._later: list[tuple[str, Outcome, SentBy]] = []
        self._leniently = False

    def judge(self, norm: Norm, breaks: Callable[[str], bool]) -> None:
        """Look who breaks a norm; who does is undone where it refuses that."""
        for name, outcome in self._outcomes.items():
            for who in outcome.offenders(norm, self._elsewhere):
                if breaks(who) and norm.refuses:
                    self._open.setdefault(name, {})[outcome.unit(who)] = norm
                    outcome.undo(who)

    @property
    def open(self) -> tuple[str, ...]:
        """The fragments in which somebody is refused who may still live through fewer events."""
        return tuple(self._open)

    def stages(
        self, events: Sequence[AnyEvent], vocabulary: Vocabulary, always: frozenset[str]
    ) -> Iterator[tuple[AnyEvent, ...]]:
        """The events of a frame that those who are refused are asked for, ever fewer.

        After each, `reconsider` takes what has become of the `open` fragments. Events of the types
        `always` are among them to the end.
        """
        kinds = {symbol for name in self._open for symbol in self._symbols(name)}
        met = frozenset[str]().union(*(vocabulary.kinds[one].subscribes for one in kinds))
        types = list(dict.fromkeys(event.type for event in events if event.type in met))
        before = frozenset(types)
        for last in range(len(types) - 1, -1, -1):
            some = frozenset(types[:last]) | always.intersection(types)
            if not self._open or not some:
                return
            if some != before:
                self._leniently = some <= always
                yield tuple([event for event in events if event.type in some])
            before = some

    def _symbols(self, name: str) -> Iterator[str]:
        fragment = self._composition.fragments[name]
        if isinstance(fragment, Columns):
            yield fragment.symbol
        else:
            yield from (one.symbol for one in agents(Scene((fragment,))))

    def reconsider(
        self, changed: Scenes, sent: SentBy, norms: Sequence[Norm], exceeds: Exceeds
    ) -> None:
        """Let units be what they become by fewer events, where no norm refuses that too.

        Of what norms send alone nothing is refused that was not allowed before either.
        """
        for name, refused in list(self._open.items()):
            old = self._composition.fragments[name]
            other = outcome_of(old, changed.get(name, Scene((old,))))
            wrong = {
                other.unit(who)
                for norm in norms
                for who in other.offenders(norm, self._elsewhere)
                if refused.get(other.unit(who)) is norm or exceeds(norm, who)
                if not (self._leniently and self._was_forbidden(norm, other, who))
            }
            self._settle(name, old, other, refused.keys() - wrong)
            self._later.append((name, other, sent))

    def _settle(self, name: str, old: Fragment, other: Outcome, units: set[str]) -> None:
        for unit in sorted(units):
            self._outcomes[name].replace(unit, other)
            del self._open[name][unit]
        if not self._open[name]:
            del self._open[name]

    def _was_forbidden(self, norm: Norm, outcome: Outcome, who: str) -> bool:
        was = outcome.was(who)
        return was is not None and norm.holds(state_of(norm, was, was, self._elsewhere))

    def ruling(self, vocabulary: Vocabulary) -> Ruling:
        """What counts in the end; all who have been refused a step are at rest."""
        overruled = {name: one for name, one in self._outcomes.items() if one.overruled}
        halted = {who for one in overruled.values() for who in one.halted}
        for name, outcome in overruled.items():
            self._changed[name] = rested(outcome.scene, outcome.halted, vocabulary.kinds)
        self._count_sent(overruled)
        return Ruling(self._changed, self._sent, tuple(overruled), tuple(sorted(halted)))

    def _count_sent(self, overruled: Mapping[str, Outcome]) -> None:
        names = {name: self._home(name) for name in self._sent}
        for _, _, sent in self._later:
            names |= {name: self._home(name) for name in sent}
        for name, home in names.items():
            if home in overruled:
                later = [(one, sent.get(name, ())) for of, one, sent in self._later if of == home]
                left = overruled[home].left(self._sent.pop(name, ()), later)
                self._sent |= {name: left} if left else {}

    def _home(self, name: str) -> str:
        """The fragment that has sent something: an agent's, or one in columns."""
        return name if name in self._composition.parts else self._composition.home(name) or name


__all__ = ["Ruling", "Sent", "Trial"]
