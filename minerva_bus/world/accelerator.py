"""The socket for machine code: which methods of a class are to be compiled, and what compiles them.

An extension installs an entry point of `minerva.accelerators`: a function that makes the
`Accelerator` of a class. It is imported by the first class that has anything to compile, because
most worlds have no such class.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError
from minerva_bus.user_code import handler_name
from minerva_bus.world.class_declaration import COMPILED, marked

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from minerva_bus.grammar.columns import Rows
    from minerva_bus.grammar.events import Event
    from minerva_bus.grammar.scene import Scene
    from minerva_bus.world.context import Frame, FrameStreams
    from minerva_bus.world.population import PopulationState, Turn

ACCELERATORS: Final = "minerva.accelerators"
IF_POSSIBLE: Final = "if possible"
REMEDY: Final = "leave out compiled=True, which runs the method agent by agent"

Mode: TypeAlias = bool | str
"""False, True, or "if possible"."""


class NotCompilable(MisuseError):
    """A method uses something that cannot be compiled.

    The message has the file, the line, the place in it, and what to write instead.
    """


class Accelerator(Protocol):
    """Runs methods and views of a class of agents on rows of a population, with Python's results.

    `methods` and `views` are the event types of those that it runs.
    """

    methods: Collection[str]
    views: Collection[str]

    def run(
        self, turn: Turn, state: PopulationState, streams: FrameStreams, frame: Frame
    ) -> NDArray[np.bool_]:
        """Process a turn; returns a mask of the rows that must run in Python, shape (rows,)."""
        ...

    def view(self, state: PopulationState, rows: Rows, event: Event) -> Scene | None:
        """The views of these rows for an event for all; None if the method itself must run."""
        ...

    def code(self) -> Iterable[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code, each with the function that compiles it."""
        ...


MakeAccelerator: TypeAlias = Callable[
    [Any, Mapping[str, Mode], Mapping[str, Mode]], tuple[Accelerator | None, list[str]]
]
"""Makes the accelerator of a class from the modes of its methods and of its views by event type.

Returns also why methods are not compiled whose mode is "if possible". Raises NotCompilable.
"""


def check_mode(compiled: object) -> None:
    """Raise MisuseError unless this is True, False or "if possible"."""
    if compiled not in (True, False, IF_POSSIBLE):
        raise MisuseError(f'compiled is True, False or "{IF_POSSIBLE}", not {compiled!r}')


def accelerated(cls: Any, default: Mode = False) -> tuple[Accelerator | None, list[str]]:
    """The accelerator of a class, None if nothing is compiled, and why methods are not.

    `default` is the mode of methods and views that are not marked. Raises NotCompilable.
    """
    methods, views = _modes(cls, default)
    if not methods and not views:
        return None, []
    installed = entries(ACCELERATORS)
    if installed:
        make: MakeAccelerator = installed[min(installed)].load()
        return make(cls, methods, views)
    functions = [cls.activities[each] for each in methods] + [cls.views[each] for each in views]
    reason = (
        f"{handler_name(functions[0])} cannot be compiled: no accelerator is installed; add the"
        f" extension fast (minerva_fast), or {REMEDY}"
    )
    if True in (*methods.values(), *views.values()):
        raise NotCompilable(reason)
    return None, [reason]


def compile_all(cls: Any, mode: Mode) -> list[str]:
    """Compile all methods and views of a class for one agent, beside those marked.

    Returns why methods are not compiled, for `mode` "if possible". Raises NotCompilable for True.
    """
    own, reasons = cls.accelerator, list[str]()
    compiled = [set[str](), set[str]()] if own is None else [{*own.methods}, {*own.views}]
    if [{*modes} for modes in _modes(cls, mode)] != compiled:
        cls.accelerator, reasons = accelerated(cls, mode)
    return reasons


def _modes(cls: Any, default: Mode) -> tuple[dict[str, Mode], dict[str, Mode]]:
    """The modes of the methods and of the views for one agent, without False, by event type."""
    # Methods for populations are activities of one agent by a wrapper.
    methods = {
        event_type: getattr(marked(cls, event_type, function), COMPILED, False) or default
        for event_type, function in sorted(cls.activities.items())
        if event_type not in cls.population
    }
    views = {
        event_type: getattr(function, COMPILED, False) or default
        for event_type, function in sorted(cls.views.items())
        if event_type not in cls.population_views
    }
    return _wanted(methods), _wanted(views)


def _wanted(modes: dict[str, Mode]) -> dict[str, Mode]:
    return {event_type: mode for event_type, mode in modes.items() if mode}
