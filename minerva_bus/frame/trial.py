"""Judges the outcome of a frame by norms; rejected agents evolve again by fewer events.

If a norm rejects an agent's outcome, the agent is evolved again without the events of the
last type, then without those of the last two types, and so on. The first outcome that no norm
rejects counts. Thus the agent loses only the step that leads to the forbidden state, and those
after it. Events from norms are never left out; in the end they are all that it receives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.fragments import Fragment
from minerva_bus.frame.outcomes import Elsewhere, FragmentOutcome, Sent, state_of
from minerva_bus.frame.population_outcomes import nothing_of, outcome_of
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.ids import repeated_in
from minerva_bus.grammar.neutral_values import rested
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.traversal import kind_counts
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.norms import Norm

SentBy = Mapping[str, tuple[AnyEvent, ...]]
Scenes = Mapping[str, Scene]
Exceeds = Callable[[Norm, str], bool]


@dataclass(frozen=True, slots=True)
class NormVerdict:
    """The outcome of a frame after norms: changed fragments, and the events that agents sent.

    `rejected`: fragments that differ from their hosts' reports. `halted`: agents with a rejected
    step, sorted; devices execute none of their actions in this frame.
    """

    changed: dict[str, Scene]
    sent: dict[str, tuple[AnyEvent, ...]]
    rejected: tuple[str, ...] = ()
    halted: tuple[str, ...] = ()


class Trial:
    """The outcome of one frame while norms judge it."""

    def __init__(
        self, composition: Composition, changed: Scenes, sent: SentBy, elsewhere: Elsewhere
    ) -> None:
        self._composition = composition
        self._changed = dict(changed)
        self._sent = dict(sent)
        self._elsewhere = elsewhere
        # In the order of the string, because replies arrive in any order, and the order of judging
        # is that of the sanctions among the events of the next frame.
        places = composition.places(changed)
        self._outcomes = {
            name: outcome_of(composition.fragments[name], changed[name])
            for name in sorted(changed, key=places)
        }
        self._open: dict[str, dict[str, Norm]] = {}
        self._later: list[tuple[str, FragmentOutcome, SentBy]] = []
        self._leniently = False

    def judge(self, norm: Norm, breaks: Callable[[str], bool]) -> None:
        """Apply a norm to all outcomes, and undo those that it rejects."""
        for name, outcome in self._outcomes.items():
            for who in outcome.offenders(norm, self._elsewhere):
                if breaks(who) and norm.refuses:
                    self._open.setdefault(name, {})[outcome.unit(who)] = norm
                    outcome.undo(who)

    @property
    def open(self) -> tuple[str, ...]:
        """The fragments with a rejected agent that may still be evolved by fewer events."""
        return tuple(self._open)

    def stages(
        self, events: Sequence[AnyEvent], vocabulary: Vocabulary, always: frozenset[str]
    ) -> Iterator[tuple[AnyEvent, ...]]:
        """Reduced events of a frame, stage by stage, by which rejected agents are evolved again.

        After each stage `reconsider` takes the results of the `open` fragments. Events of the
        types `always` are part of all stages.
        """
        kinds = {
            kind for name in self._open for kind in kind_counts(self._composition.fragments[name])
        }
        met = frozenset[str]().union(*(vocabulary.kinds[kind].subscribes for kind in kinds))
        # In the order of the frame. Types that none of the agents subscribes to cannot have caused
        # the forbidden state, so they need no stage.
        types = list(dict.fromkeys(event.type for event in events if event.type in met))
        before = frozenset(types)
        # By type and not by event: each stage costs a round trip, and a frame has few types
        # but may have hundreds of events.
        for last in range(len(types) - 1, -1, -1):
            stage = frozenset(types[:last]) | always.intersection(types)
            if not self._open or not stage:
                return
            # A stage that leaves out only a type that is always
            # included would repeat the one before.
            if stage != before:
                self._leniently = stage <= always
                yield tuple([event for event in events if event.type in stage])
            before = stage

    def reconsider(
        self, changed: Scenes, sent: SentBy, norms: Sequence[Norm], exceeds: Exceeds
    ) -> None:
        """Accept outcomes of units by fewer events, unless a norm rejects them as well.

        By events from norms alone, a state that was forbidden before the frame is not rejected.
        """
        for name, refused in list(self._open.items()):
            old = self._composition.fragments[name]
            other = outcome_of(old, changed.get(name, Scene((old,))))
            wrong = {
                other.unit(who)
                for norm in norms
                for who in other.offenders(norm, self._elsewhere)
                # The norm that rejected the unit has counted this act already. For other norms it
                # is a new act, which counts only if their limit is reached.
                if refused.get(other.unit(who)) is norm or exceeds(norm, who)
                if not (self._leniently and self._was_forbidden(norm, other, who))
            }
            self._settle(name, old, other, refused.keys() - wrong)
            # Kept even if units of it were rejected: accepted ones have
            # sent their events in this stage.
            self._later.append((name, other, sent))

    def _settle(self, name: str, old: Fragment, other: FragmentOutcome, units: set[str]) -> None:
        for unit in sorted(units):
            self._outcomes[name].replace(unit, other)
            del self._open[name][unit]
        if not self._open[name]:
            del self._open[name]

    def _was_forbidden(self, norm: Norm, outcome: FragmentOutcome, who: str) -> bool:
        was = outcome.was(who)
        return was is not None and norm.holds(state_of(norm, was, was, self._elsewhere))

    def verdict(self, vocabulary: Vocabulary) -> NormVerdict:
        """The final outcome; agents with a rejected step are at rest."""
        rejected = {n: outcome for n, outcome in self._outcomes.items() if outcome.rejected}
        for name, outcome in rejected.items():
            # Units of different stages may share an agent if a host has moved it between them.
            if repeated_in(outcome.scene) is not None:
                rejected[name] = nothing_of(cast("Columns", self._composition.fragments[name]))
        halted = {who for outcome in rejected.values() for who in outcome.halted}
        for name, outcome in rejected.items():
            # At rest, because in the next frame λ would assume that the action was executed.
            self._changed[name] = rested(outcome.scene, outcome.halted, vocabulary.kinds)
        self._count_sent(rejected)
        return NormVerdict(self._changed, self._sent, tuple(rejected), tuple(sorted(halted)))

    def _count_sent(self, rejected: Mapping[str, FragmentOutcome]) -> None:
        names = {name: self._home(name) for name in self._sent}
        for _, _, sent in self._later:
            names |= {name: self._home(name) for name in sent}
        for name, home in names.items():
            if home in rejected:
                later = [
                    (other, sent.get(name, ())) for of, other, sent in self._later if of == home
                ]
                left = rejected[home].left(self._sent.pop(name, ()), later)
                self._sent |= {name: left} if left else {}

    def _home(self, name: str) -> str:
        """The fragment of a sender: an agent's, or one in columns."""
        return name if name in self._composition.parts else self._composition.home(name) or name


__all__ = ["NormVerdict", "Sent", "Trial"]
