"""Environments for reinforcement learning: worlds in the interfaces of PettingZoo and Gymnasium.

    env = parallel_env("meadow", agents="ARabbit", act="eAlarm", frames=500)
    observations, infos = env.reset(seed=7)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    observations, rewards, terminations, truncations, infos = env.step(actions)

They need `pip install 'minerva-bus[rl]'`.
"""

from minerva_bus.rl.making import parallel_env, single_env

__all__ = ["parallel_env", "single_env"]
