"""Environments for reinforcement learning: worlds in the interfaces of PettingZoo and Gymnasium.

    env = parallel_env("meadow", agents="ARabbit", act="eAlarm", frames=500)
    observations, infos = env.reset(seed=7)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)

`follow_policy` lets agents of a world act by a trained policy. All of this needs
`pip install 'minerva-bus[rl]'`; importing this package raises MisuseError without it.
"""

from minerva_bus.collect.data_tables import needed

for _library in ("gymnasium", "pettingzoo"):
    needed(_library, "rl")

from minerva_learning.following import follow_policy  # noqa: E402
from minerva_learning.making import (  # noqa: E402
    parallel_env,
    population_env,
    single_env,
    vector_env,
)

__all__ = ["follow_policy", "parallel_env", "population_env", "single_env", "vector_env"]
