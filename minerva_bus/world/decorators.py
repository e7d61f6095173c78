"""The marks of agents' methods: `on` makes one an evolution λ, `view` a view θ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from minerva_bus.errors import MisuseError
from minerva_bus.world.accelerator import Mode, check_mode
from minerva_bus.world.class_declaration import (
    COMPILED,
    ON,
    POPULATION,
    PROBABILITY,
    TOGETHER,
    VIEW,
)

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


def view(*event_types: str, population: bool = False, compiled: Mode = False) -> Callable[[_F], _F]:
    """Mark a method `(self, event)` as the view θ for these visual event types (equation 4).

    The method returns a string of primitives and transformations, and changes nothing.

    Args:
        event_types: names of event types with `visual=True`, such as "ePicture".
        population: `self` is a population, and the method returns a string with a node per agent:
            primitives and transformations whose parameters are arrays make one.
        compiled: for agents in columns, run the method as machine code. "if possible" gives a
            warning if it cannot be compiled.

    Raises:
        MisuseError: no event type is named, or a view for populations is to be compiled.

    Example:
        >>> @view("ePicture")
        ... def picture(self, event):
        ...     return TMove(self.x, self.y)(PFox())

    """
    check_mode(compiled)
    if compiled and population:
        raise MisuseError("a view with compiled=True is for one agent; leave out population=True")
    return _mark(VIEW, event_types, population, False, 1.0, compiled)


def _mark(
    name: str,
    event_types: tuple[object, ...],
    population: bool,
    together: bool,
    probability: float | str,
    compiled: Mode,
) -> Callable[[_F], _F]:
    named = all(isinstance(event_type, str) and event_type for event_type in event_types)
    if not (event_types and named):
        raise MisuseError('name the event types: @on("eHunger"), @view("ePicture")')

    def mark(function: _F) -> _F:
        # Built-in functions and partial objects have no attributes for the marks, or no name.
        if isinstance(function, type) or not hasattr(function, "__dict__") or not _name(function):
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


def _name(function: object) -> str:
    return getattr(function, "__name__", "")
