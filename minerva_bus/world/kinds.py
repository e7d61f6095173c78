"""Agent classes by the symbol of their kind, and the error of a failing method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, cast

from minerva_bus.errors import MisuseError, UserCodeError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.source import handler_name
from minerva_bus.world.agent import Agent


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
    if isinstance(classes, dict | Mapping):
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
