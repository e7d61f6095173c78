"""Steps 2 to 9 of Table 2, once the generators have answered."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from itertools import accumulate
from typing import Final

from minerva_bus.errors import VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.calling import NOTHING
from minerva_bus.frame.constraints import Offers
from minerva_bus.frame.core import Phase
from minerva_bus.frame.endings import Endings
from minerva_bus.frame.enforcement import PEOPLE
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.plainly import plainly
from minerva_bus.frame.showing import Showing
from minerva_bus.grammar.batch import AnyEvent, count_of
from minerva_bus.grammar.events import Event
from minerva_bus.world.evolution import Policy
from minerva_bus.world.order import collect

HANDED_OVER: Final = "~handed"
"""Source in `FrameInputs.taken` of people's orders that generators have taken."""

AGENTS: Final = "#"
"""The source of all that agents send; no generator can have this name."""

BALANCED_EVERY: Final = 32
"""Frames after which it is looked whether hosts have work for the same time."""


class Steps(Endings):
    """One frame: its events, its evolution and views, and what follows from them."""

    def _collect(self) -> None:
        """Steps 2 to 4: e*, e^v and e^u."""
        due, later = self._due_views(closing=False), dict[str, list[AnyEvent]]()
        if self._logged is None:
            later = self._hold_back()
        else:  # Events that were too many for one frame have been held back before.
            due = tuple(sorted({*due, *self._logged.due}))
        self._gather(due)
        for source, events in later.items():
            self._inbox[source] = [*events, *self._inbox.get(source, ())]
        self.phase = Phase.EVOLVE
        if not self.world.frames or self.frame + 1 < self.world.frames:
            self._ask_ahead(self.frame + 1)
        self._dispatch()

    def _hold_back(self) -> dict[str, list[AnyEvent]]:
        """Take out of what waits, by source, the events that are too many for one frame."""
        later: dict[str, list[AnyEvent]] = {}
        for source, events in self._inbox.items():
            single = accumulate(isinstance(event, Event) for event in events)
            if len(events) > self.most_taken and source != PEOPLE:
                taken = bisect_right(list(single), self.most_taken)
                later[source] = events[taken:]
                self._inbox[source] = events[:taken]
        return {source: events for source, events in later.items() if events}

    def _gather(self, due: tuple[str, ...]) -> None:
        """The frame's events; `due` are the types of which a device wants a view by itself."""
        taken = self._take_inbox()
        self._taken = {**taken, HANDED_OVER: self._handed_over} if self._handed_over else taken
        self._due = due
        sources: dict[str, Sequence[AnyEvent]] = {**taken}
        if self._emitted:
            sources[AGENTS] = self._emitted
        for member, reply in self._ticked.items():
            if reply.events:
                sources[member] = [*reply.events, *sources.get(member, ())]
            if reply.saved is not None or member in self._saved:
                self._saved[member] = NOTHING if reply.saved is None else reply.saved
        self._held = {}
        self._leave_out_foreign(sources)
        if due:
            sources["~device"] = self._visual_events(due)
        self._people = self._people or self._standing_for_people(sources)
        allowed = self._allowed(sources)
        if allowed:
            self._sort_events(collect(self.world.order, allowed))

    def _leave_out_foreign(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Leave events out whose sender has died, or is none that their generator speaks for."""
        for name in sorted(sources.keys() & self.world.speaks_for.keys()):
            kept = self._speaking.kept(name, sources[name])
            dropped = sum(map(count_of, sources[name])) - sum(map(count_of, kept))
            sources[name] = kept
            if dropped:
                member = self.members.get(name)
                if not member.dropped:
                    gone = "from agents that are not in the string"
                    self._say(name, f"sent {dropped} events {gone}; such events are left out")
                member.dropped += dropped

    def _take_inbox(self) -> dict[str, list[AnyEvent]]:
        """What waits for this frame; orders that a generator takes came too late for it."""
        taken, self._inbox = self._inbox, {}
        late = [one for one in taken.get(PEOPLE, ()) if self.members.takers(one.type)]
        if late:
            self._inbox[PEOPLE] = late
            in_time = [one for one in taken.pop(PEOPLE) if not self.members.takers(one.type)]
            taken |= {PEOPLE: in_time} if in_time else {}
        return taken

    def _ask_ahead(self, frame: int) -> None:
        """Ask generators that do not depend on the world before the frame begins, once each."""
        for member in self.members.index.ahead:
            if self._asked_ahead.get(member, -1) < frame:
                self._asked_ahead[member] = frame
                self._send(member, m.TickRequest(frame))

    def _sort_events(self, events: tuple[AnyEvent, ...]) -> None:
        types = self.world.vocabulary.events
        self._events = events
        self._visual = tuple([event for event in events if types[event.type].visual])
        self._evolving = tuple([event for event in events if not types[event.type].visual])

    def _due_views(self, closing: bool) -> tuple[str, ...]:
        """The event types of those devices that are the source of their own, sorted."""
        due = {
            event_type
            for hello in self.members.index.sources
            if closing or self.frame % hello.every == 0
            for event_type in hello.draws
        }
        rates = self.members.index.rates
        due.update(rates if closing else [one for one in self._glances if one in rates])
        return tuple(sorted(due))

    def _visual_events(self, due: tuple[str, ...]) -> tuple[Event, ...]:
        types = self.world.vocabulary.events
        return tuple([types[event_type]() for event_type in due])

    # --- steps 5 and 6: evolution and views ---

    def _dispatch(self) -> None:
        if self._rearrange or (self.frame % BALANCED_EVERY == 0 and self._distribution.lopsided):
            self._rearrange = False
            self._distribution.arrange(self.offers())
            self._count_homeless()
            self._name_unoffered()
        self._layout = self.composition.layout
        asked = self._to_ask()
        for host in asked:
            self._parts[host, 0] = tuple(self._distribution.fragments_of(host))
            self._give(host)
        plain = [host for host in asked if self.members.declines_columns(host)]
        others = tuple([host for host in asked if host not in plain])
        if others:
            request = m.EvolveRequest(self.frame, others, self._evolving, self._visual)
            self._send(s.HOSTS, request)
        for host in plain:
            mine = self._parts[host, 0]
            events, visual = self._evolving, self._visual
            self._send(host, m.EvolveRequest(self.frame, (host,), events, visual, only=mine))
        self._finish_if_done()

    def _to_ask(self) -> tuple[str, ...]:
        """The hosts that answer in this frame; fragments without one wait or stand still."""
        literal = self.world.policy is Policy.LITERAL and self.phase is Phase.EVOLVE
        if not (literal or self._evolving or self._visual):
            return ()
        if self._distribution.unplaced:
            self._strand(self._distribution.unplaced)
        if literal:  # Equation 3 then changes every agent, whoever the events are for.
            return tuple(self._distribution.occupied)
        return tuple(self._distribution.concerned(self._evolving, self._visual))

    def offers(self) -> Offers:
        """What each host may evolve, as far as the world's placement allows."""
        return self.world.placement.allowed(self.members.offers(), self.members.machines())

    def _count_homeless(self) -> None:
        """Say how many agents find no place, where that has changed and rules are why."""
        placement, homeless = self.world.placement, self._distribution.homeless
        if homeless == self._homeless or not (placement.rules or placement.agents_per_host):
            return
        self._homeless = homeless
        if homeless:
            most = placement.agents_per_host
            full = f"a host takes {most} (agents_per_host)" if most else "[placement] says where"
            self._say(
                "placement",
                f"{homeless} agents have no host and stand still: {full}; attach another one",
            )
        else:
            self._say("placement", "every agent has a host again")

    def _name_unoffered(self) -> None:
        """Say, once, which kinds no host has ever offered: the world may lack a process.

        Where one has, its loss was told.
        """
        self._offered.update(self.members.offers().values())
        unoffered = {
            kinds
            for kinds in self._distribution.unplaced.values()
            if not any(kinds <= offered for offered in self._offered)
        }
        for kinds in sorted(map(sorted, unoffered - self._unoffered)):
            what = f"all of {', '.join(kinds)}" if len(kinds) > 1 else kinds[0]
            still = "such agents stand still; attach one that does"
            self._say("placement", f"no host evolves {what}: {still}")
        self._unoffered |= unoffered

    def _give(self, host: str) -> None:
        lacking = self._distribution.lacking(host)
        if lacking is not None:
            self._send(host, lacking)

    def _strand(self, unplaced: dict[str, frozenset[str]]) -> None:
        """Fragments that no host can evolve wait for one that comes back, or stand still."""
        back = self.members.awaited_kinds()
        for fragment, kinds in unplaced.items():
            if kinds <= back:
                self._stranded.add(fragment)
            else:
                self._left_out.add(fragment)

    def _ask_again(self, fragments: list[str]) -> None:
        """Ask for some fragments once more in this frame, wherever they are placed now."""
        self._rearrange = self.world.placement.agents_per_host > 0
        self._distribution.arrange(self.offers(), between=False)
        self._stranded = set()
        unplaced = self._distribution.unplaced
        self._strand({one: unplaced[one] for one in fragments if one in unplaced})
        self._ask(fragments)
        self._finish_if_done()

    def _ask(self, fragments: Iterable[str]) -> None:
        """Ask the hosts of some fragments for what these become, and look like, once more."""
        placed: dict[str, list[str]] = {}
        for fragment in fragments:
            host = self._distribution.host_of(fragment)
            if host is not None:
                placed.setdefault(host, []).append(fragment)
        for host, mine in sorted(placed.items()):
            self._part += 1
            self._parts[host, self._part] = tuple(mine)
            self._give(host)
            events, visual = self._asked_by or (self._evolving, self._visual)
            request = m.EvolveRequest(self.frame, (host,), events, visual, self._part, tuple(mine))
            self._send(host, request)

    def _finish_if_done(self) -> None:
        if self._parts or self._stranded:
            return
        if self.phase is Phase.EVOLVE:
            if not self._judged():
                self._commit()
        elif self.phase is Phase.CLOSING:
            self._show()
            self._stop()

    # --- steps 7 to 10: output, and the next frame ---

    def _judged(self) -> bool:
        """Judge what the hosts have answered; whether some are asked again, by fewer events."""
        self._hear()
        fewer = next(self._fewer, None)
        if fewer is None or self._trial is None:
            return False
        self._asked_by = fewer, ()
        refused = self._trial.open
        for fragment in refused:
            self._distribution.overruled(fragment)
        self._ask(refused)
        return bool(self._parts) or self._judged()

    def _hear(self) -> None:
        """Take what has become of fragments before the norms, the first time or by fewer events."""
        self._answers.append(len(self._replies) - sum(self._answers))
        if self._asked_by is None:
            self._trial = self._try_outcome()
            self._fewer = self._fewer_events()
        elif self._trial is not None:
            self._enforcement.reconsider(self._trial, self._changed, self._sent)
        if self._trial is not None:
            self._changed, self._sent = {}, {}

    def _commit(self) -> None:
        if self._apply():
            self._end_or_go_on()

    def _apply(self) -> bool:
        """Make the frame's outcome the string; False where it cannot be one."""
        overruled = self._enforce()
        made = {name: one for name, one in self._changed.items() if name not in overruled}
        self._show()
        self._note_ends()
        self._emitted = self._sent_in_order()
        try:
            self._rearrange |= self.composition.replace(self._changed)
        except VocabularyError as error:
            self._fail(f"frame {self.frame}: {error}")
            return False
        for fragment, scene in made.items():
            host = self._changed_by.get(fragment)
            if host is not None:
                self._distribution.changed(host, fragment, scene)
            else:  # Who made it is gone, and its heir may have been given what was there before.
                self._distribution.overruled(fragment)
        for fragment in overruled:
            self._distribution.overruled(fragment)
        self._out.append(
            s.FrameDone(self.frame, self._record(self.frame), self._events, self._inputs())
        )
        self.frame += 1
        if self._changed:
            self._stirred = self.frame
        return True

    def _inputs(self) -> FrameInputs:
        return FrameInputs(
            self.frame,
            self._due,
            self._ticked,
            self._taken,
            self._layout,
            self._replies,
            self._inbox,
            self._people,
            tuple(self._answers),
            tuple(sorted(self._left_out)),
        )

    def _record(self, frame: int) -> Callable[[], m.FrameRecord]:
        events, changed = self._events, self._changed
        return lambda: m.FrameRecord(frame, events, changed, self.composition.scene.digest)

    def _sent_in_order(self) -> list[AnyEvent]:
        """What agents have sent, in the order in which they stand in the string."""
        if not self._sent:
            return []
        places = self.composition.places(self._sent)
        return [event for name in sorted(self._sent, key=places) for event in self._sent[name]]

    def _show(self) -> None:
        """Step 7: every device gets its view of w, the string that this frame began with."""
        for event_type in sorted({event.type for event in self._visual}):
            showing = self._showings.setdefault(event_type, Showing(event_type))
            view = showing.next(
                self.frame,
                self.composition.skeleton,
                self._views.get(event_type, {}),
                self._view_patches.get(event_type, {}),
                self.composition.fragments,
                self._halted,
            )
            devices = self.members.devices(event_type)
            last = self.phase is Phase.CLOSING
            for member, hello in devices:
                shown = showing.unpatched(view) if hello.plain else view
                if hello.coupled:
                    self._send(member.name, shown)
                elif last:  # Nothing follows from which an observer could see that it missed it.
                    self._send(member.name, showing.key())
                elif hello.plain:
                    self._out.append(s.Show(event_type, plainly(shown), member.name))
            if not last and any(not (hello.coupled or hello.plain) for _, hello in devices):
                self._out.append(s.Show(event_type, view))

    def _end_or_go_on(self) -> None:
        reason = self._why_over()
        if reason:
            self._close(reason)
        else:
            self.phase = Phase.READY
            self._out.append(s.Ready(self.frame))

    def _why_over(self) -> str:
        """Why no frame follows, or the empty text."""
        if self.composition.empty:
            return "the string is empty"
        if self.finished:
            return self.finished
        if self.world.frames and self.frame >= self.world.frames:
            return "the frames are over"
        return ""

    def _close(self, reason: str) -> None:
        """End a world that has come to its end: its last string is shown once more."""
        self._reason = reason
        due = self._due_views(closing=True)
        self._begin_frame_state()
        self._visual = self._visual_events(due)
        self.phase = Phase.CLOSING
        self._dispatch()
