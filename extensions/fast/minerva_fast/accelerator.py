"""The accelerator of a class of agents: checked when the class is made, compiled at its first run.

population → columns → kernel (machine code) → changes, newborns, events, figures
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.wording import install
from minerva_bus.world.class_declaration import IF_POSSIBLE, Mode, NotCompilable
from minerva_bus.world.context import Frame, FrameStreams
from minerva_bus.world.population import PopulationState, Turn
from minerva_fast.calls import KernelCall
from minerva_fast.machine_code import Kernel, has_numba, load_kernel
from minerva_fast.methods import checked_methods, checked_views
from minerva_fast.printing import FAULT, GONE, Program
from minerva_fast.values import Emission, Newborn

Functions = Mapping[str, Callable[..., Any]]
Check = Callable[[Any, Functions], dict[str, Program]]


def accelerate(
    cls: Any, methods: Mapping[str, Mode], views: Mapping[str, Mode]
) -> tuple[FastAccelerator | None, list[str]]:
    """The accelerator of a class, an entry point of `minerva.accelerators`."""
    reasons: list[str] = []
    if not has_numba() and IF_POSSIBLE in (*methods.values(), *views.values()):
        reasons.append(f"{cls.__name__} runs agent by agent, without numba: {install('fast')}")
        methods, views = (
            {event: mode for event, mode in modes.items() if mode != IF_POSSIBLE}
            for modes in (methods, views)
        )
    chosen = _possible(cls, cls.activities, methods, checked_methods, reasons)
    shown = _possible(cls, cls.views, views, checked_views, reasons)
    return (FastAccelerator(cls, chosen, shown) if chosen or shown else None), reasons


def _possible(
    cls: Any, functions: Functions, modes: Mapping[str, Mode], check: Check, reasons: list[str]
) -> Functions:
    """The functions that are compiled; `reasons` gets why others are not."""
    chosen: dict[str, Callable[..., Any]] = {}
    for event_type, mode in modes.items():
        function = functions[event_type]
        if mode == IF_POSSIBLE:
            try:
                check(cls, {event_type: function})
            except NotCompilable as error:
                reasons.append(str(error))
                continue
        chosen[event_type] = function
    return chosen


class FastAccelerator:
    """Runs the compiled methods and views of an agent class on the rows of a population."""

    def __init__(self, cls: Any, methods: Functions, views: Functions) -> None:
        self._cls = cls
        self._methods = _CheckedCode(cls, methods, checked_methods)
        self._views = _CheckedCode(cls, views, checked_views)
        self.methods = frozenset(methods)
        self.views = frozenset(views)

    def code(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code, each with the function that compiles it."""
        for checked, event_types in ((self._methods, self.methods), (self._views, self.views)):
            for event_type in sorted(event_types):
                yield checked.program(event_type).title, partial(checked.kernel, event_type)

    def run(
        self, turn: Turn, state: PopulationState, streams: FrameStreams, frame: Frame
    ) -> NDArray[np.bool_]:
        """Process a turn; returns a mask of the rows that must run in Python, shape (rows,)."""
        program, kernel = self._methods.kernel(turn.event.type)
        call = KernelCall(program, state, turn)
        # A duration that is an int would give an int, which the kernel does not have.
        if not call.fits or type(frame.dt) is not float:
            return np.ones(len(turn.rows), np.bool_)
        outcomes = call.run(kernel, streams, frame)
        state.turn += 1
        call.store()
        for index, output in enumerate(program.outputs):
            if isinstance(output, Newborn):
                call.bear(index, output, self._cls)
            elif isinstance(output, Emission):
                call.send(index, output)
        gone = turn.rows[outcomes == GONE]
        if len(gone):
            state.leave(gone)
        return outcomes == FAULT

    def view(self, state: PopulationState, rows: Rows, event: Event) -> Scene | None:
        """The views of these rows; None if the method itself must run, to raise its error."""
        program, kernel = self._views.kernel(event.type)
        call = KernelCall(program, state, Turn(event, rows))
        if not call.fits or (call.run(kernel, None, None) == FAULT).any():
            return None
        return call.shown()


class _CheckedCode:
    """Methods or views of a class by event type.

    Constants of the module are part of the machine code. If one of them has changed, the functions
    are checked and compiled again.
    """

    def __init__(self, cls: Any, functions: Functions, check: Check) -> None:
        self._check = partial(check, cls, functions)
        self._checked = self._check()
        self._kernels: dict[str, Kernel] = {}

    def program(self, event_type: str) -> Program:
        """The checked form of the function for an event type. Raises NotCompilable."""
        if not all(program.current() for program in self._checked.values()):
            self._checked = self._check()
            self._kernels = {}
        return self._checked[event_type]

    def kernel(self, event_type: str) -> tuple[Program, Kernel]:
        """The program and the machine code of the function for an event type.

        Raises NotCompilable, and MisuseError without numba.
        """
        program = self.program(event_type)
        kernel = self._kernels.get(event_type)
        if kernel is None:
            kernel = self._kernels[event_type] = load_kernel(program.text, "compiled methods")
        return program, kernel
