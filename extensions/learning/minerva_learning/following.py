"""Trained policies as agents: a method that observes the agent and applies the policy.

The observation and the action are those of training, so a policy that was trained in
`parallel_env(world, agents, act, observe)` needs the same `act` and `observe` here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias, cast

import numpy as np
from gymnasium import spaces

from minerva_bus.collect.data_tables import needed
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_input
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.agent import Agent, Handler
from minerva_bus.world.class_declaration import on
from minerva_bus.world.context import Context
from minerva_bus.world.visualization import visualize
from minerva_learning.acting import Acting, AnySpace, acting_of
from minerva_learning.observing import Observe, Observing, observing_of
from minerva_learning.shared import taken
from minerva_learning.states import KindStates

Policy: TypeAlias = Callable[[Any], Any]
"""A function of an observation that returns an action."""

MAX_MODEL_BYTES: Final = 2 << 30
"""Bytes of an .onnx file: the limit of its format."""

_DTYPES: Final[Mapping[str, Any]] = {
    "tensor(float)": np.float32,
    "tensor(double)": np.float64,
}
"""Kinds of inputs that an observation can have."""


def follow_policy(
    policy: Policy | str | Path,
    *,
    when: str,
    act: EventType | Sequence[Event | None],
    observe: Observe = None,
) -> Callable[[Any, Event, Context], Scene | None]:
    """A method for an agent class that applies a policy at each event of a type.

    The agent is observed, and receives the event of the action at once; then the method of its base
    class for the type `when` runs, if there is one. This equals an action in an environment if the
    event type of the action directly precedes `when` in the order of the world, and nothing before
    it changes what is observed.

    Args:
        policy: a function of an observation that returns an action, without a state or random
            numbers of its own; or an .onnx file, which needs minerva-bus[onnx]: its first output
            is the action, or the scores of those of a `Discrete` space.
        when: the event type, such as that of a clock.
        act: the event type whose data are the action, or a list of events to choose from.
        observe: as for `parallel_env`; a function receives the agent's own string.

    Raises MisuseError, also if a library is missing; when the method runs, for what does not fit.

    Example:
        >>> class TrainedRabbit(Rabbit):
        ...     follow = follow_policy(policy, when="eStep", act=eSteer, observe=["left", "right"])

    """
    if not isinstance(act, EventType) and isinstance(act, Event | str):
        raise MisuseError(f"act: expected an event type or a list of events, not {act!r:.60}")

    @cache
    def parts(cls: type[Agent]) -> _FollowedMethod:
        return _FollowedMethod.of(cls, follow, when, act, policy)

    observers: dict[type[Agent], Observing] = {}

    @on(when)
    def follow(self: Any, event: Event, moment: Context) -> Scene | None:
        cls = cast("type[Agent]", type(self))
        own, states = parts(cls), KindStates(self.string, cls.kind, self.id)
        if cls not in observers:
            observers[cls] = observing_of(
                observe,
                states,
                lambda string, name: visualize(string, [Event(name)], [cls], moment.number),
            )
        observation = taken(observers[cls].rows(states), 0)
        action = own.acting.event(self.id, own.policy(observation))
        if action is not None:
            replaced = cls.activities[action.type](self, action, moment)
            if replaced is not None:
                return replaced
        return None if own.after is None else own.after(self, event, moment)

    return follow


@dataclass(frozen=True, slots=True)
class _FollowedMethod:
    """What a class that follows a policy needs, found once; `after` is the overridden method."""

    acting: Acting
    policy: Policy
    after: Handler | None

    @classmethod
    def of(
        cls,
        agents: type[Agent],
        follow: object,
        when: str,
        act: EventType | Sequence[Event | None],
        policy: Policy | str | Path,
    ) -> _FollowedMethod:
        """The actions of a class, its policy, and the method that `follow` overrides."""
        if isinstance(act, EventType):
            known = {act.name: act}
        else:
            known = {event.type: EventType(event.type) for event in act if event is not None}
        acting = acting_of(act, agents.kind, known)
        order = agents.__mro__
        owner = next(at for at, base in enumerate(order) if follow in vars(base).values())
        inherited = [base for base in order[owner + 1 :] if issubclass(base, Agent)]
        after = inherited[0].activities.get(when)
        function = onnx_policy(policy, acting.space) if isinstance(policy, str | Path) else policy
        return cls(acting, function, after)


def onnx_policy(path: str | Path, space: AnySpace) -> Policy:
    """The policy in an .onnx file, which takes one observation at a time.

    Args:
        path: of the file; its input has the shape of an observation, after one of batches.
        space: of the actions; for a `Discrete` one the output may be a score for each action.

    Raises MisuseError if onnxruntime is missing or cannot read the file, and when it decides, if
    the observation has another shape.

    """
    runtime: Any = needed("onnxruntime", "onnx")
    options = runtime.SessionOptions()
    # With several threads the order of sums, and so the last bit of a result, would vary.
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        check_input(Path(path), MAX_MODEL_BYTES)
        session = runtime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    # Its exceptions have no common class.
    except Exception as error:
        raise MisuseError(f"{path}: onnxruntime cannot read it: {error!s:.200}") from None
    inputs = [(given.name, given.type) for given in session.get_inputs()]
    if len(inputs) != 1 or inputs[0][1] not in _DTYPES:
        own = ", ".join(f"{name}: {kind}" for name, kind in inputs) or "none"
        raise MisuseError(f"{path}: its inputs are {own}; expected one, of floats: the observation")
    name, dtype = inputs[0][0], _DTYPES[inputs[0][1]]

    def decide(observation: Any) -> Any:
        seen = np.asarray(observation, dtype)
        try:
            output = session.run(None, {name: seen[None]})[0][0]
        except Exception as error:
            of = f"an observation of shape {seen.shape}"
            raise MisuseError(f"{path}: it has no action for {of}: {error!s:.200}") from None
        if isinstance(space, spaces.Discrete) and np.size(output) > 1:
            return int(np.argmax(output))
        return output

    return decide
