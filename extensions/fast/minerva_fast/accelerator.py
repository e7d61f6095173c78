"""The accelerator of a class of agents: checked when the class is made, compiled at its first run.

population → columns → kernel (machine code) → changes, newborns, events
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.wording import install
from minerva_bus.world.class_declaration import IF_POSSIBLE, Mode, NotCompilable
from minerva_bus.world.context import Frame, FrameStreams
from minerva_bus.world.population import PopulationState, Turn
from minerva_fast.calls import KernelCall
from minerva_fast.machine_code import Kernel, has_numba, load_kernel
from minerva_fast.methods import checked_methods
from minerva_fast.results import FAILED, GONE
from minerva_fast.values import Method, Newborn


def accelerate(cls: Any, modes: Mapping[str, Mode]) -> tuple[FastAccelerator | None, list[str]]:
    """The accelerator of a class, an entry point of `minerva.accelerators`."""
    chosen: dict[str, Callable[..., Any]] = {}
    reasons: list[str] = []
    if not has_numba() and IF_POSSIBLE in modes.values():
        reasons.append(f"{cls.__name__} runs agent by agent, without numba: {install('fast')}")
        modes = {event: mode for event, mode in modes.items() if mode != IF_POSSIBLE}
    for event_type, mode in modes.items():
        method = {event_type: cls.activities[event_type]}
        if mode == IF_POSSIBLE:
            try:
                checked_methods(cls, method)
            except NotCompilable as error:
                reasons.append(str(error))
                continue
        chosen |= method
    return (FastAccelerator(cls, chosen) if chosen else None), reasons


class FastAccelerator:
    """Runs the compiled methods of an agent class on the rows of a population.

    Constants of the module are part of the machine code. If one of them has changed, the methods
    are checked and compiled again.
    """

    def __init__(self, cls: Any, methods: Mapping[str, Callable[..., Any]]) -> None:
        self._cls = cls
        self.methods = methods
        self._checked = checked_methods(cls, methods)

    def code(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code, each with the function that compiles it."""
        for event_type in sorted(self.methods):
            yield self.checked(event_type).title, partial(self._kernel, event_type)

    def checked(self, event_type: str) -> Method:
        """The checked form of the method for an event type. Raises NotCompilable."""
        if not all(method.current() for method in self._checked.values()):
            self._checked = checked_methods(self._cls, self.methods)
        return self._checked[event_type]

    def _kernel(self, event_type: str) -> tuple[Method, Kernel]:
        """The checked form and the machine code of the method for an event type.

        Raises NotCompilable, and MisuseError without numba.
        """
        method = self.checked(event_type)
        return method, load_kernel(method.text, "compiled methods")

    def run(
        self, turn: Turn, state: PopulationState, streams: FrameStreams, frame: Frame
    ) -> NDArray[np.bool_]:
        """Process a turn; returns a mask of the rows that must run in Python, shape (rows,)."""
        method, kernel = self._kernel(turn.event.type)
        call = KernelCall(method, state, turn)
        # A duration that is an int would give an int, which the kernel does not have.
        if not call.fits or type(frame.dt) is not float:
            return np.ones(len(turn.rows), np.bool_)
        outcomes = call.run(kernel, streams, frame)
        state.turn += 1
        call.store()
        for index, output in enumerate(method.outputs):
            if isinstance(output, Newborn):
                call.bear(index, output, self._cls)
            else:
                call.send(index, output)
        gone = turn.rows[outcomes == GONE]
        if len(gone):
            state.leave(gone)
        return outcomes == FAILED
