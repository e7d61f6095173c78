"""What the frame algorithm needs to know of a world before it begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from minerva_bus.errors import VocabularyError
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.constraints import PlacementRules
from minerva_bus.frame.messages import ViewShown
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.evolution import Policy
from minerva_bus.world.lineage import newest_copy
from minerva_bus.world.norms import Norm
from minerva_bus.world.order import Order


@dataclass(frozen=True, slots=True)
class World:
    """A world: its initial string w₀, its vocabulary and the rules of its frames.

    `dt` is how many simulated seconds a frame lasts. The world ends after `frames` frames (0: no
    limit), when its string is ε, or when every agent of the kinds that send `until` has sent it or,
    instead, `give_up`, by which an agent says that it cannot.
    In `real_time` something outside, as a robot, sees to it that a frame lasts `dt` seconds.
    `norms` say what nobody may do. `people` are the event types that people may send although a
    generator makes them. `speaks_for` has, by generator, the kinds and `#id`s of agents in whose
    name it may send events. `placement` says where agents may live; it cannot reach the
    string unless some find no place.

    One that goes on from a checkpoint, `past`, begins with that frame's string; `shown` are the
    last views as keyframes, on which coupled devices still have to act.

    Raises VocabularyError where, under the literal policy, an agent has the id of a copy that a
    frame to come may make.
    """

    name: str
    scene: Scene
    vocabulary: Vocabulary
    seed: int = 0
    dt: float = 0.1
    order: Order = field(default_factory=Order)
    policy: Policy = Policy.SEQUENTIAL
    frames: int = 0
    until: str = ""
    give_up: str = ""
    real_time: bool = False
    expected: frozenset[str] = frozenset()
    norms: tuple[Norm, ...] = ()
    people: tuple[str, ...] = ()
    speaks_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    placement: PlacementRules = field(default_factory=PlacementRules)
    past: Checkpoint = field(default_factory=Checkpoint)
    shown: Sequence[ViewShown] = ()

    def __post_init__(self) -> None:
        for agent in agents(self.scene) if self.policy is Policy.LITERAL else ():
            frame = newest_copy((agent.id,))
            if frame >= self.past.frame:
                raise VocabularyError(
                    f"{agent.symbol}#{agent.id} has the id of a copy that frame {frame} makes"
                    ' under policy = "literal"',
                    expected="an id without :FRAME-NUMBER",
                    source=f"world {self.name}",
                )
