"""Frame timing in real time, outside of the frame algorithm, which has no clock.

Pausing, stepping and pacing only decide when `Begin` is given. They cannot influence the string.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.world_state import Phase, WorldProgress
from minerva_bus.runtime.pace import Overruns, Pace, ViewClock, real_period
from minerva_bus.runtime.runner import Sink

_BEGIN: Final = s.Begin()

_PARTS: Final = {m.TickReply: ("events", Phase.TICK), m.EvolveReply: ("evolution", Phase.EVOLVE)}
"""The part of a frame that a reply ends, and the phase that waits for it."""

LAST_VIEW_SECONDS: Final = 5.0
"""Time for the frame that shows the last string before a person's stop."""


class FrameSchedule(Sink):
    """Times the frames of one algorithm; `clock` gives monotonic seconds.

    `due` is when the next frame begins, or None while a frame is in progress, members are missing
    or the world is paused. `notify` is called with a text when frames overrun real time.
    """

    def __init__(
        self,
        algorithm: WorldProgress,
        rate: float,
        clock: Callable[[], float],
        notify: Callable[[str], None],
    ) -> None:
        self.pace = Pace(rate)
        self.overruns = Overruns()
        self.due: float | None = None
        self.last_frame_at = 0.0
        self.follows = False
        self._algorithm = algorithm
        self._clock = clock
        self._notify = notify
        self._views = ViewClock()
        self._omits_views = False
        self._ready = False
        self._end: s.End | None = None
        self._end_by = 0.0

    @property
    def rests(self) -> bool:
        """Whether the next frame would change nothing, so that it may begin later than `due`."""
        return self._algorithm.at_rest

    def rest_until(self) -> float:
        """Time until which a world at rest may skip frames; a view may be due before."""
        rates = self._algorithm.members.index.rates
        return self.pace.rest(self.last_frame_at, self._views.next(rates))

    @property
    def next_at(self) -> float | None:
        """Time at which the next frame begins unless the schedule changes."""
        if self.due is None or not self.rests:
            return self.due
        return max(self.due, self.rest_until())

    @property
    def shows_by_clock(self) -> bool:
        """Whether an observer asks for views per second, not per frame."""
        return bool(self._algorithm.members.index.rates)

    def begin(self) -> s.Begin | s.End:
        """The stimulus that begins the frame that is due, or the end that follows the last one."""
        if self._end is not None and self.pace.paused:
            return self._end
        now = self._clock()
        # No frame is due until the algorithm reports that this one is over.
        self.due, self._ready = None, False
        self.pace.began()
        period = real_period(self.pace.rate, self._algorithm.world)
        if self.follows != (period > 0):
            # A world that runs as fast as possible has no overruns, and needs no times of replies.
            self.follows = period > 0
            self.runner.refresh()
            self.overruns.began(period, now)
        elif period:
            self.overruns.began(period, now)
        rates = self._algorithm.members.index.rates
        if not rates:
            self._omits_views = False
            return _BEGIN
        # No later frame would correct the views if this is the last one before a pause.
        due = self._views.due(now, rates, everything=self.pace.paused)
        self._omits_views = len(due) < len(rates)
        return s.Begin(due)

    def pause(self) -> None:
        """Pause, after one more frame if the latest one left out views that were not due yet."""
        self.pace.pause(after=int(self._omits_views))
        self.repace()

    def stop(self, end: s.End) -> None:
        """End the world, after one more frame if the latest one left out views, as with a pause.

        A second request, and a frame that takes longer than LAST_VIEW_SECONDS, end it at once.
        """
        if self._end is not None or not self._omits_views:
            self.runner.handle(end)
            return
        self._end, self._end_by = end, self._clock() + LAST_VIEW_SECONDS
        self.pause()

    def check_end(self, now: float) -> None:
        """End the world if the frame before its end takes too long; `now` in monotonic seconds."""
        if self._end is not None and now >= self._end_by:
            self.runner.handle(self._end)
            self._end_by = float("inf")

    @property
    def pauses_before(self) -> int:
        """The frame before which the world pauses, if no further frames are requested."""
        return self._algorithm.frame + self._algorithm.in_frame + (self.pace.left or 0)

    def repace(self) -> None:
        """Apply a changed pace: the next frame may begin now, later or not at all."""
        # While a frame is in progress, `ready` applies the new pace when the frame is over.
        if self._ready:
            self.due = self.pace.due(self._clock())

    def received(self, stimulus: s.Stimulus) -> None:
        """Note which member answers last, for the report of an overrun."""
        if not isinstance(stimulus, (m.TickReply, m.EvolveReply)):
            return
        # The frame has not waited for a reply that comes late or twice, and after a part that is
        # over its time would make the duration of the next one negative.
        part, awaited = _PARTS[type(stimulus)]
        if stimulus.frame == self._algorithm.frame and self._algorithm.phase is awaited:
            self.overruns.answered(part, stimulus.member, self._clock())

    def ready(self, notice: s.Ready) -> None:
        """Time the beginning of the next frame."""
        self._ready = True
        is_last = self._end is not None and self.pace.paused
        self.due = self._clock() if is_last else self.pace.due(self._clock())

    def frame_done(self, notice: s.FrameDone) -> None:
        """Time the end of a frame."""
        self.last_frame_at = self._clock()
        if self.follows:
            late = self.overruns.done(notice.frame, self.last_frame_at)
            if late:
                self._notify(late)
