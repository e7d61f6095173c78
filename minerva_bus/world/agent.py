"""Agent classes: the attributes are the state st ∈ ST, the methods are λ and θ.

    class Fox(Agent, symbol="AFox"):
        energy: float = 10.0

        @on("eHunger")
        def starve(self, hunger, moment):
            self.energy -= hunger.amount
            if self.energy <= 0:
                return EMPTY

        @view("ePicture")
        def picture(self, event):
            return TMove(self.x, self.y)(PFox())

A method marked with `@on` is λ for an event type (equation 2). It changes `self`, or returns the
string of L(M) that replaces the agent: ε for a death, `self.string + self.child(...)` for a birth.
A method marked with `@view` is θ (equation 4): it returns primitives and transformations only.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from inspect import unwrap
from operator import is_
from typing import Any, ClassVar, Self, TypeVar, cast

import numpy as np

from minerva_bus.errors import (
    MinervaError,
    MisuseError,
    SignatureError,
    StateError,
    UserCodeError,
    nearest,
)
from minerva_bus.grammar.columns import SCALARS, Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids, no_id
from minerva_bus.grammar.scene import AGENT_ID, EMPTY, AgentNode, Scene
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import AgentKind, Vocabulary
from minerva_bus.user_code import handler_name
from minerva_bus.values import text, text_list, whole_number
from minerva_bus.world.class_declaration import (
    ON,
    POPULATION,
    VIEW,
    Accelerator,
    accelerated,
    chances_of,
    handlers,
    state_of,
    takes_batch,
)
from minerva_bus.world.context import Context
from minerva_bus.world.expressions import expose_attributes
from minerva_bus.world.population import as_one, check_births, child_id, view_as_one

_F = TypeVar("_F", bound=Callable[..., Any])
Handler = Callable[[Any, Any, Context], Scene | None]
ViewHandler = Callable[[Any, Event], Scene]


class Agent:
    """Base of all agent classes: attributes are the state, methods the evolution and the views.

    A subclass declares a kind a^D_ST of agents. Its annotated attributes are the state st ∈ ST; D
    are the event types that its methods name with `on` and `view`.

    **Life cycle.** In each frame, and for each of its events in the world's order, an agent is made
    of its node in the string, the method marked with `on` runs, and the new state becomes the node.
    An attribute that is not declared would be lost and is an error, except if its name begins with
    `_`: it lives until the end of the frame. λ of a frame sees the string with which the frame
    began; events that agents emit belong to the next frame. To die, a method returns `EMPTY`; to
    give birth, `self.string + self.child(...)`; to become something else, any other string of L(M).

    **State fields.** `bool`, `int`, `float`, `str`, `Literal["a", "b"]`, units (`Metres`,
    `Degrees`, `Seconds`, `MetresPerSecond`), `tuple[X, ...]`, `Cells` and `Reals` (read-only
    matrices, see `writable`), `Scene`. A default makes an attribute optional in strings.
    `births: int = 0` is required for `child`.

    **moment** is a `Context`, or a `BatchContext` in a method for populations: the frame's number
    and time, the agent's random numbers, and `emit`. A method uses no other clock, random numbers
    or global state; then the string is the same with any number of processes.

    Args:
        id: unique in the world; letters, digits and `_ : -`, the first a letter, digit or `_`.
        scope: the string inside the agent's brackets.
        state: attributes by name; those without a default are required.

    Class arguments: `symbol` is the name of the kind, such as "AFox"; without it a subclass
    declares no kind of its own. `rest` names the attributes that are commands, such as a robot's
    action. If a norm rejects the result of λ, they are reset: to 0, false, "" or (), and a string
    to its primitives without transformations.

    Raises:
        MisuseError: an id, attribute or value that the kind does not allow; and, when the class is
            made, a declaration that is not possible.

    Example:
        >>> class Fox(Agent, symbol="AFox"):
        ...     x: Metres = 0.0
        ...     energy: float = 10.0
        ...
        ...     @on("eHunger")
        ...     def starve(self, hunger, moment):
        ...         self.energy -= hunger.amount
        ...         return EMPTY if self.energy <= 0 else None
        >>> print(Fox("f1", x=2.0).string)
        AFox#f1<x=2, energy=10>()

    """

    kind: ClassVar[AgentKind]
    activities: ClassVar[dict[str, Handler]] = {}
    views: ClassVar[dict[str, ViewHandler]] = {}
    population: ClassVar[dict[str, Handler]] = {}
    population_views: ClassVar[dict[str, ViewHandler]] = {}
    batches: ClassVar[frozenset[str]] = frozenset()
    """Event types with a method for one agent that takes all events of a frame in one call."""
    accelerator: ClassVar[Accelerator | None] = None
    """What runs methods for one agent as machine code on the rows of a population."""

    id: str
    scope: Scene
    _node: AgentNode | None

    def __init_subclass__(
        cls, symbol: str = "", rest: tuple[str, ...] | None = None, **kwargs: Any
    ) -> None:
        super().__init_subclass__(**kwargs)
        own: Any = vars(cls).get("__init__")
        code: Any = getattr(unwrap(getattr(own, "func", own)), "__code__", None)
        # One that calls this of Agent, by `super` or by its name, is a shorter way to write an
        # agent of a string.
        if code is not None and "__init__" not in code.co_names:
            never = f"{cls.__name__}.__init__ would not be called for agents of a string"
            how = f'such as `energy: float = 3.0`, and write {cls.__name__}("a", energy=3.0)'
            problem = f"{never}; declare attributes instead, {how}"
            raise SignatureError(problem, own)
        activities, views = handlers(cls, ON), handlers(cls, VIEW)
        cls.population = _for_many(activities)
        cls.population_views = _for_many(views)
        cls.batches = frozenset([e for e, function in activities.items() if takes_batch(function)])
        cls.activities = activities | {e: as_one(f) for e, f in cls.population.items()}
        cls.views = views | {e: view_as_one(f) for e, f in cls.population_views.items()}
        inherited: AgentKind | None = getattr(cls, "kind", None)
        name = symbol or (inherited.name if inherited is not None else "")
        if rest is None:
            rest = inherited.rest if inherited is not None else ()
        if isinstance(rest, str):
            raise MisuseError(
                f'{cls.__name__}: rest is a tuple of attributes: write rest=("{rest}",)'
            )
        if name:
            state = state_of(cls, Agent)
            # Tuples are sorted, because kinds of a host and of the world are compared with each
            # other.
            cls.kind = AgentKind(
                name,
                state,
                frozenset(cls.activities),
                frozenset(cls.views),
                chances_of(cls, activities),
                tuple(sorted(rest)),
            )
            _check_columns(cls.kind, cls.population or cls.population_views)
            cls.accelerator, reasons = accelerated(cls)
            for reason in reasons:
                warnings.warn(reason, UserWarning, stacklevel=3)
            expose_attributes(cls, [each.name for each in state.all if each.type.kind in SCALARS])

    @classmethod
    def machine_code(cls) -> Iterable[tuple[str, Callable[[], object]]]:
        """Titles of the compiled code of this class, each with the function that compiles it."""
        return () if cls.accelerator is None else cls.accelerator.code()

    def __init__(self, id: str, *, scope: Scene = EMPTY, **state: Any) -> None:
        if AGENT_ID.fullmatch(text("id", id)) is None:
            raise MisuseError(no_id(id))
        if not hasattr(self, "kind"):
            raise MisuseError(f"{type(self).__name__} has no symbol, so there are no such agents")
        fields = self.kind.fields
        values = fields.bind(f"{self.kind.name}#{id}", (), state)
        self.__dict__.update(zip(fields.names, values, strict=True))
        self.id = id
        self.scope = scope
        self._node = None

    @classmethod
    def thaw(cls, node: AgentNode) -> Self:
        """A mutable agent with the state of a node. Raises MisuseError if that does not fit."""
        fields, values = cls.kind.fields, node.values
        # Nodes that a vocabulary has checked have this very tuple of names, so most need no
        # comparison.
        if node.names is not fields.names:
            try:
                _, values = fields.refit(f"{node.symbol}#{node.id}", node.names, values)
            except Unfit as unfit:
                raise MisuseError(str(unfit)) from None
        agent = cls.__new__(cls)
        agent.__dict__.update(zip(fields.names, values, strict=True))
        agent.id = node.id
        agent.scope = node.scope
        agent._node = node
        return agent

    def freeze(self) -> AgentNode:
        """A node with the current state; the node that it was thawed from if nothing changed.

        Raises MisuseError if an attribute has a value of a wrong type, or if an attribute was added
        or deleted.
        """
        # Attributes are checked here, after a method, so that the error names the method and the
        # event.
        fields, state, old = self.kind.fields, self.__dict__, self._node
        values = [state[name] for name in fields.names if name in state]
        # Names are compared only if their number differs: this runs for every agent and event.
        if len(state) != len(values) + len(OWN) or len(values) != len(fields.names):
            self._check_names()
        # Nodes that arrived from the bus have the names of the world's vocabulary, not the class's.
        named = old is not None and (old.names is fields.names or old.names == fields.names)
        stayed = old is not None and self.scope is old.scope and named
        # The same node again is how the rest of the frame knows that the agent has not changed: it
        # is neither sent, nor hashed, nor visualized.
        kept = old is None or old.id == self.id
        if not (kept and isinstance(self.scope, Scene)):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise self._wrong_own(old)
        if old is not None and stayed and all(map(is_, values, old.values)):
            return old
        try:
            former = old.values if old is not None and named else ()
            fitted = tuple(fields.fitted(f"{self.kind.name}#{self.id}", values, former))
        except Unfit as unfit:
            raise StateError(str(unfit), unfit.attribute) from None
        # Equal values in new objects, such as a float computed again.
        if old is not None and stayed and same_values(fitted, old.values):
            return old
        node = AgentNode(self.kind.name, self.id, fields.names, fitted, self.scope)
        return node.fitted(fields)

    def _wrong_own(self, old: AgentNode | None) -> StateError:
        """The error for another id, or for a scope that is no string."""
        if old is not None and old.id != self.id:
            return StateError(f"an agent keeps its id; #{old.id} cannot become #{self.id}", "id")
        return StateError(f"the scope of #{self.id} must be a string, not {self.scope!r}", "scope")

    def _check_names(self) -> None:
        names, state = self.kind.fields.names, self.__dict__
        owner = f"{self.kind.name}#{self.id}"
        for name in names:
            if name not in state:
                raise StateError(f"{owner}: {name} has been deleted", name)
        for name in sorted(state):
            if name not in names and name not in OWN and not name.startswith("_"):
                declare = "declare it in the class"
                if hasattr(type(self), name):
                    declare = f"declare it with its type, as in `{name}: float = 0.0`"
                raise StateError(
                    f"{owner} has no {name}, so it would be lost; {declare},"
                    f" or begin its name with _ if it is temporary{nearest(name, list(names))}",
                    name,
                )

    @classmethod
    def many(cls, ids: Ids | Sequence[str] | str, count: int = 0, **state: Any) -> Scene:
        """The string of n agents, held in columns.

        Args:
            ids: n ids, or the stem of `count` ids.
            count: the number n of agents, if `ids` is a stem.
            state: attributes by name: arrays of shape (n,), or one value for all.

        Raises:
            MisuseError: an invalid id, or values of a wrong type or shape.

        Example:
            `Fox.many("fox", 1000, x=array)` are fox0 to fox999.

        """
        if isinstance(ids, str):
            count = whole_number(f"{cls.kind.name}.many: count", count, most=1 << 31)
            ids = Ids.numbered(ids, range(count))
        column = ids if isinstance(ids, Ids) else Ids.of(text_list("ids", ids))
        fields, owner = cls.kind.fields, cls.kind.name
        columns = fields.columns(owner, state, len(column))
        if not len(column):
            return EMPTY
        if (invalid := column.strange) is not None:
            raise MisuseError(no_id(invalid))
        return Scene((Columns(owner, fields.names, columns, len(column), column),))

    @property
    def string(self) -> Scene:
        """The agent in its current state, as a string."""
        return Scene((self.freeze(),))

    def writable(self, name: str) -> Any:
        """A matrix attribute as a writable array; copied at most once in a frame."""
        array: np.ndarray[Any, Any] = getattr(self, name)
        # Matrices in nodes are read-only, because nodes of several frames share them.
        if not array.flags.writeable:
            array = array.copy()
            setattr(self, name, array)
        return array

    def child(self, kind: type[Agent] | None = None, **state: Any) -> Scene:
        """The string of a newborn, with an id that derives from this agent's.

        Increments the attribute `births`, which the parent's kind must declare, so that ids are
        equal wherever and whenever the world runs.

        Args:
            kind: the class of the newborn; default: that of this agent.
            state: its attributes by name.

        Raises:
            MisuseError: the kind has no `births`, or the state does not fit.

        Example:
            `return self.string + self.child(x=self.x, energy=5.0)`

        """
        check_births(self.kind)
        births: int = self.__dict__["births"] + 1
        self.__dict__["births"] = births
        # Until the agent is made of a node again; `AgentStep` looks whether it is lost.
        born = self.__dict__["_born"] = (kind or type(self))(child_id(self.id, births), **state)
        return born.string

    def counted(self, own: AgentNode) -> AgentNode:
        """The node `own` of this agent with the current number of births.

        In `self.string + self.child()` the string is older than the birth, so the next child would
        get the same id otherwise.
        """
        births, known = self.__dict__.get("births"), own.state.get("births")
        if not isinstance(births, int) or not isinstance(known, int) or births <= known:
            return own
        state = {**own.state, "births": births}
        return replace(own, values=tuple(state.values()))

    def __repr__(self) -> str:
        try:
            return str(self.string)
        except MinervaError as error:
            return f"<{self.kind.name}#{self.id}, not valid: {error}>"


def _for_many(methods: dict[str, _F]) -> dict[str, _F]:
    return {event: each for event, each in methods.items() if getattr(each, POPULATION, False)}


def _check_columns(kind: AgentKind, population: Collection[str]) -> None:
    for field in kind.fields.all if population else ():
        if field.type.kind not in SCALARS:
            raise MisuseError(
                f"{kind.name} has methods for populations, so its attributes must be numbers,"
                f" bools or texts; {field.name} is a {field.type}"
            )


OWN = frozenset({"id", "scope", "_node"})


class ActivityError(UserCodeError):
    """User code of an agent failed; names its method, the agent, the event, frame and cause.

    `handler` is None if the agent's state was wrong before any method ran.
    """

    def __init__(
        self, handler: Callable[..., Any] | None, node: AgentNode, event: Event, frame: int
    ) -> None:
        shown = str(event)
        # Data such as matrices make texts of any length.
        cut = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "…"
        what = "the state" if handler is None else handler_name(handler)
        super().__init__(f"{what} of {node.symbol}#{node.id} at {cut}", handler)
        self.event = shown
        self.frame = frame

    def __str__(self) -> str:
        # The frame goes between the place and the cause of the message.
        where, _, cause = super().__str__().partition(self.where)
        return f"{where}{self.where} in frame {self.frame}{cause}"


_SHOWN = 200


Kinds = Mapping[str, type[Agent]]


def kinds_of(classes: Iterable[type[Agent]] | Kinds) -> Kinds:
    """Agent classes by the symbol of their kind. Raises MisuseError."""
    # A dictionary is found without the checks of abstract classes, which each frame would make.
    if isinstance(classes, (dict, Mapping)):
        return cast("Kinds", classes)
    if not isinstance(classes, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"expected a list of agent classes, not {classes!r:.60}")
    kinds: dict[str, type[Agent]] = {}
    for cls in classes:
        if not isinstance(cls, type):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"expected a class of agents, not {cls!r:.60}")
        if not hasattr(cls, "kind"):
            raise MisuseError(
                f'{cls.__name__} has no symbol: class {cls.__name__}(Agent, symbol="A...")'
            )
        if kinds.setdefault(cls.kind.name, cls) is not cls:
            raise MisuseError(f"two classes have the symbol {cls.kind.name}")
    return kinds


def with_own_fields(vocabulary: Vocabulary, kinds: Kinds) -> Vocabulary:
    """The vocabulary, with the very fields of these classes where they are equal.

    A vocabulary that has been received has equal fields of its own. Values that fit the very fields
    of a class are not fitted again before and after each of its methods.
    """
    own = {name: cls.kind.fields for name, cls in kinds.items() if name in vocabulary.kinds}
    received = {name: vocabulary.kinds[name] for name in own}
    shared = {
        name: replace(kind, fields=own[name])
        for name, kind in received.items()
        if kind.fields is not own[name] and kind.fields == own[name]
    }
    return replace(vocabulary, kinds={**vocabulary.kinds, **shared}) if shared else vocabulary
