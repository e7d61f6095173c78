"""Declarations of agent classes: the state ST by annotations, D by marked methods.

`on` makes a method an evolution λ, `view` a view θ.

`Accelerator` is the socket for machine code. An extension installs an entry point of
`minerva.accelerators`: a function that makes the `Accelerator` of a class. It is imported by the
first class that has anything to compile, because most worlds have no such class.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from inspect import get_annotations
from types import FunctionType, MethodType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Final,
    Protocol,
    TypeAlias,
    TypeVar,
    cast,
    get_origin,
    get_type_hints,
)

from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, SignatureError
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.user_code import handler_name
from minerva_bus.world.expressions import NO_DEFAULT, default_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from minerva_bus.world.context import Frame, FrameStreams
    from minerva_bus.world.population import PopulationState, Turn


ON = "_minerva_on"
VIEW = "_minerva_view"
POPULATION = "_minerva_population"
TOGETHER = "_minerva_together"
PROBABILITY = "_minerva_probability"
COMPILED = "_minerva_compiled"


ARGUMENTS: Final = {
    ON: ("an activity", ("self", "event", "moment")),
    VIEW: ("a view", ("self", "event")),
}


def handlers(cls: type, mark: str) -> dict[str, Callable[..., Any]]:
    """The methods with a mark by event type; those of a subclass precede inherited ones.

    A method that overrides a marked one without a mark inherits its event types. Raises MisuseError
    if a class has two methods for an event type, and SignatureError for wrong arguments.
    """
    methods: dict[str, str] = {}
    # From the root down, so that a subclass overrides the handlers of its bases.
    for base in reversed(cls.__mro__):
        own: dict[str, str] = {}
        for name, function in vars(base).items():
            if base is cls:
                check_uncovered(cls, name, function, mark)
            event_types: tuple[str, ...] = getattr(function, mark, ())
            if event_types or not callable(function):
                # A marked method replaces all event types that its bases have marked it for, and a
                # name that is no longer a method has none. An unmarked override keeps them.
                methods = {event: method for event, method in methods.items() if method != name}
            for event_type in event_types:
                if own.setdefault(event_type, name) != name:
                    raise MisuseError(
                        f"{base.__name__} has two methods for {event_type}:"
                        f" {own[event_type]} and {name}"
                    )
        methods |= own
    # Methods of base classes were checked when those were defined.
    for name in set(methods.values()) & vars(cls).keys():
        check_signature(getattr(cls, name), *ARGUMENTS[mark])
    return {event_type: getattr(cls, name) for event_type, name in methods.items()}


def check_uncovered(cls: type, name: str, function: Any, mark: str) -> None:
    """Raise SignatureError if a decorator above `@on` or `@view` hides the mark of a method."""
    if getattr(function, mark, ()):
        return
    wrapped = [getattr(function, attribute, None) for attribute in _WRAPPED]
    for inner in (*wrapped, *_enclosed(function)):
        # A method may refer to marked functions with other names.
        own = getattr(inner, "__qualname__", "") == f"{cls.__qualname__}.{name}"
        if own and getattr(inner, mark, ()):
            what = "@on" if mark == ON else "@view"
            how = f"write {what} as the first line above it, before other decorators"
            problem = f"{cls.__name__}.{name} would never be called: {how}"
            raise SignatureError(problem, cast("Callable[..., Any]", inner))


def _enclosed(function: Any) -> Iterator[object]:
    """The objects to which a function within another one refers."""
    for cell in getattr(function, "__closure__", None) or ():
        try:
            yield cell.cell_contents
        except ValueError:  # It has no value yet.
            continue


_WRAPPED: Final = ("__wrapped__", "fget", "func")
"""Attributes in which decorators keep the decorated function."""


def takes_batch(function: Callable[..., Any]) -> bool:
    """Whether a method is for one agent and takes all events of a frame in one call."""
    return getattr(function, TOGETHER, False) and not getattr(function, POPULATION, False)


def chances_of(
    cls: type, activities: Mapping[str, Callable[..., Any]]
) -> tuple[tuple[str, float | str], ...]:
    """Event types, sorted, that a class responds to with a probability: h of a^{d,h}.

    A method that overrides a marked one without a mark inherits its probability.
    """
    chances: dict[str, float | str] = {}
    for event_type, function in activities.items():
        probability: float | str = getattr(marked(cls, event_type, function), PROBABILITY, 1.0)
        if probability != 1.0:
            chances[event_type] = probability
    return tuple(sorted(chances.items()))


def marked(cls: type, event_type: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """The method that marks a method, or the one that it overrides, for an event type."""
    for base in cls.__mro__:
        method = vars(base).get(function.__name__)
        if method is not None and event_type in getattr(method, ON, ()):
            return method
    return function


def state_of(cls: type, root: type) -> Fields:
    """The attributes that a class and its bases below `root` declare by annotations.

    Class variables and names that begin with _ are not part of the state. Raises MisuseError.
    """
    hints = _hints(cls)
    taken = {name for name in (*dir(root), *get_annotations(root)) if not name.startswith("_")}
    annotations: dict[str, Any] = {}
    for base in reversed(cls.__mro__):
        # Mixins that are not agents declare no state.
        if base is root or not issubclass(base, root):
            continue
        for name in get_annotations(base):
            hint = hints[name]
            if name.startswith("_") or hint is ClassVar or get_origin(hint) is ClassVar:
                continue
            if name in taken:
                raise MisuseError(f"{cls.__name__}.{name} is taken: every agent has {name}")
            default = default_of(base, name)
            annotations[name] = hint if default is NO_DEFAULT else Default(hint, default)
    return Fields.of(annotations)


def _hints(cls: type) -> dict[str, Any]:
    try:
        # The extras are the `Annotated` types of units, ranges and words.
        return get_type_hints(cls, include_extras=True)
    except NameError as error:
        raise MisuseError(
            f"the annotations of {cls.__name__} cannot be read ({error}); types of attributes"
            " must be imported at the top of the module, not within a function"
        ) from None
    # An annotation as a text is evaluated here, so it may raise anything.
    except Exception as error:
        raise MisuseError(
            f"the annotations of {cls.__name__} cannot be read ({error}); annotate attributes with"
            " types, such as x: float"
        ) from None


def check_signature(
    function: Any, what: str, expected: Sequence[str], *, may_yield: bool = False
) -> None:
    """Raise SignatureError if a function cannot be called with the expected arguments.

    `expected` are the names of positional arguments, beginning with `self`; `what` describes the
    function in the error. Nothing awaits an `async` function, and only functions that `may_yield`
    are iterated: others would never run. Only functions and methods are checked, not objects that
    can be called.
    """
    if not isinstance(function, FunctionType | MethodType):
        return
    if inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function):
        problem = f"{handler_name(function)} is async, so it would never run; write def"
        raise SignatureError(f"{problem}, and wait in a thread of your own", function)
    if inspect.isgeneratorfunction(function) and not may_yield:
        problem = f"{handler_name(function)} has a yield, so it would never run"
        raise SignatureError(f"{problem}; {what} returns its result", function)
    try:
        # The wrapper of a decorated function is what is called.
        signature = inspect.signature(function, follow_wrapped=False)
    except ValueError:
        return
    try:
        # Only number and kind of the arguments matter; the names are placeholders.
        signature.bind(*expected)
    except TypeError:
        names = ", ".join(str(value) for value in signature.parameters.values())
        problem = f"{handler_name(function)} takes ({names}); {what} takes ({', '.join(expected)})"
        raise SignatureError(problem, function) from None


ITERATED: Final = ("generate", "generates")
"""The methods of services whose result may be any iterable."""


def check_overridden(cls: type, base: type, names: Sequence[str]) -> None:
    """Raise SignatureError if a class overrides methods of its base with other arguments."""
    for name in names:
        function = vars(cls).get(name)
        if function is not None:
            expected = list(inspect.signature(getattr(base, name)).parameters)
            may_yield = name in ITERATED
            check_signature(function, f"{base.__name__}.{name}", expected, may_yield=may_yield)


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
    """Runs methods of a class of agents on rows of a population, with Python's results.

    `methods` are the event types of those that it runs.
    """

    methods: Collection[str]

    def run(
        self, turn: Turn, state: PopulationState, streams: FrameStreams, frame: Frame
    ) -> NDArray[np.bool_]:
        """Process a turn; returns a mask of the rows that must run in Python, shape (rows,)."""
        ...

    def code(self) -> Iterable[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code, each with the function that compiles it."""
        ...


MakeAccelerator: TypeAlias = Callable[
    [Any, Mapping[str, Mode]], tuple[Accelerator | None, list[str]]
]
"""Makes the accelerator of a class from the modes of its methods by event type.

Returns also why methods are not compiled whose mode is "if possible". Raises NotCompilable.
"""


def check_mode(compiled: object) -> None:
    """Raise MisuseError unless this is True, False or "if possible"."""
    if compiled not in (True, False, IF_POSSIBLE):
        raise MisuseError(f'compiled is True, False or "{IF_POSSIBLE}", not {compiled!r}')


def accelerated(cls: Any, default: Mode = False) -> tuple[Accelerator | None, list[str]]:
    """The accelerator of a class, None if nothing is compiled, and why methods are not.

    `default` is the mode of methods that are not marked. Raises NotCompilable.
    """
    methods = _modes(cls, default)
    if not methods:
        return None, []
    installed = entries(ACCELERATORS)
    if installed:
        make: MakeAccelerator = installed[min(installed)].load()
        return make(cls, methods)
    first = handler_name(cls.activities[next(iter(methods))])
    reason = (
        f"{first} cannot be compiled: no accelerator is installed; add the extension fast"
        f" (minerva_fast), or {REMEDY}"
    )
    if True in methods.values():
        raise NotCompilable(reason)
    return None, [reason]


def compile_all(cls: Any, mode: Mode) -> list[str]:
    """Compile all methods of a class for one agent, beside those marked.

    Returns why methods are not compiled, for `mode` "if possible". Raises NotCompilable for True.
    """
    own, reasons = cls.accelerator, list[str]()
    if {*_modes(cls, mode)} != (set[str]() if own is None else {*own.methods}):
        cls.accelerator, reasons = accelerated(cls, mode)
    return reasons


def _modes(cls: Any, default: Mode) -> dict[str, Mode]:
    """The modes of the methods for one agent, without False, by event type."""
    # Methods for populations are activities of one agent by a wrapper.
    methods = {
        event_type: getattr(marked(cls, event_type, function), COMPILED, False) or default
        for event_type, function in sorted(cls.activities.items())
        if event_type not in cls.population
    }
    return {event_type: mode for event_type, mode in methods.items() if mode}


_F = TypeVar("_F", bound=Callable[..., Any])


def on(
    *event_types: str,
    population: bool | None = None,
    together: bool = False,
    probability: float | str = 1.0,
    compiled: bool | str = False,
) -> Callable[[_F], _F]:
    """Mark a method `(self, event, moment)` as the evolution λ for these event types (equation 2).

    The method changes attributes of `self`, or returns the string of L(M) that replaces the agent;
    None keeps it.

    Args:
        event_types: names, such as "eHunger".
        population: `self` is a population (world/population.py): attributes are arrays of shape
            (n,), a row for each agent, and the method returns nothing.
        together: `event` is an `EventBatch` of all events of the type in a frame: data are arrays
            with a row per event, and `event.row` has the receivers. Implies `population` unless
            that is False: then `self` is one agent and the batch has its events only, for example
            the beams of a scan.
        probability: h of a^{d,h} (section 5), a number from 0 to 1 or the name of an attribute: the
            agent responds to each event of these types with that probability.
        compiled: run the method for one agent as machine code over the columns of a population,
            with the same results; needs minerva-bus[fast]. `"if possible"` leaves a method as it is
            if it uses something that cannot be compiled, and warns.

    Raises:
        MisuseError: no event type is named, or the probability is neither.
        NotCompilable: when the class is made: `compiled=True`, and the method cannot be.

    Example:
        >>> @on("eHunger", probability=0.5)
        ... def starve(self, hunger, moment):
        ...     self.energy -= hunger.amount

    """
    if isinstance(probability, bool) or not isinstance(probability, float | int | str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError("a probability is a number from 0 to 1, or the name of an attribute")
    h = probability if isinstance(probability, str) else float(probability)
    for_population = together and not compiled if population is None else population
    check_mode(compiled)
    if compiled and for_population:
        raise MisuseError("a method with compiled=True is for one agent; leave out population=True")
    return _mark(ON, event_types, for_population, together, h, compiled)


def view(*event_types: str, population: bool = False) -> Callable[[_F], _F]:
    """Mark a method `(self, event)` as the view θ for these visual event types (equation 4).

    The method returns a string of primitives and transformations, and changes nothing.

    Args:
        event_types: names of event types with `visual=True`, such as "ePicture".
        population: `self` is a population, and the method returns a string with a node per agent:
            primitives and transformations whose parameters are arrays make one.

    Raises:
        MisuseError: no event type is named.

    Example:
        >>> @view("ePicture")
        ... def picture(self, event):
        ...     return TMove(self.x, self.y)(PFox())

    """
    return _mark(VIEW, event_types, population, False, 1.0)


def _mark(
    name: str,
    event_types: tuple[object, ...],
    population: bool,
    together: bool,
    probability: float | str,
    compiled: Mode = False,
) -> Callable[[_F], _F]:
    named = all(isinstance(event_type, str) and event_type for event_type in event_types)
    if not (event_types and named):
        raise MisuseError('name the event types: @on("eHunger"), @view("ePicture")')

    def mark(function: _F) -> _F:
        # Built-in functions and partial objects have no attributes for the marks, or no name.
        named = hasattr(function, "__dict__") and getattr(function, "__name__", "")
        if isinstance(function, type) or not named:
            what = "@on" if name == ON else "@view"
            raise MisuseError(
                f"{what} marks a method, written with def; {function!r:.80} is of type"
                f" {type(function).__name__}"
            )
        setattr(function, COMPILED, compiled)
        setattr(function, name, event_types)
        setattr(function, POPULATION, population)
        setattr(function, TOGETHER, together)
        setattr(function, PROBABILITY, probability)
        return function

    return mark
