"""Declaration of a world: the input of the frame algorithm before the first frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from minerva_bus.errors import VocabularyError
from minerva_bus.frame.messages import ViewShown
from minerva_bus.frame.placement import PlacementRules
from minerva_bus.frame.stimuli import Checkpoint
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.evolution import Policy
from minerva_bus.world.norms import Norm
from minerva_bus.world.population import newest_copy
from minerva_bus.world.priority import Priority


@dataclass(frozen=True, slots=True)
class WorldSpec:
    """A world: its initial string w₀, its vocabulary and the rules of its frames.

    `dt`: simulated seconds per frame. The world ends after `frames` frames (0: no limit), when its
    string is ε, or when every agent of the kinds that send `until` has sent `until` or `give_up`.
    `real_time`: an external process, such as a robot, makes each frame last `dt` seconds.
    `norms`: the norms of the world. `people`: event types that people may send although a generator
    makes them. `speaks_for`: by generator, the kinds and `#id`s of agents in whose name it may send
    events. `placement`: which hosts may evolve which agents; it affects the string only if an
    agent has no host.

    A resumed world starts from the checkpoint `past` and the string of that frame; `shown` are the
    last views as keyframes, on which coupled devices still have to act.

    Raises VocabularyError if, under the literal policy, an agent has the id of a copy that a later
    frame may make.
    """

    name: str
    scene: Scene
    vocabulary: Vocabulary
    seed: int = 0
    dt: float = 0.1
    order: Priority = field(default_factory=Priority)
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
        # Ids of copies contain the frame that makes them. A string that already has
        # such an id of a later frame would then have two agents with one id.
        for agent in agents(self.scene) if self.policy.rules.makes_copies else ():
            frame = newest_copy((agent.id,))
            if frame >= self.past.frame:
                raise VocabularyError(
                    f"{agent.symbol}#{agent.id} has the id of a copy that frame {frame} makes"
                    f' under policy = "{self.policy.value}"',
                    expected="an id without :FRAME-NUMBER",
                    source=f"world {self.name}",
                )
