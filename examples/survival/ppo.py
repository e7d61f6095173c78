"""Proximal policy optimization (Schulman et al., 2017, arXiv:1707.06347) in numpy.

`learn` trains one policy for all rows of a `population_env`. Actions are normal around the output
of a small network; another one estimates the value of an observation.
"""

from __future__ import annotations

import numpy as np

GAMMA, LAMBDA, CLIP, RATE = 0.99, 0.95, 0.2, 3e-3
EPOCHS, BATCH, HIDDEN = 6, 512, 16


class Network:
    """A layer of tanh and a linear one, trained by Adam."""

    def __init__(self, random, inputs, outputs):
        first = random.normal(size=(inputs, HIDDEN)) / np.sqrt(inputs)
        last = 0.01 * random.normal(size=(HIDDEN, outputs))
        self.weights = [first, np.zeros(HIDDEN), last, np.zeros(outputs)]
        self._moments = [(np.zeros_like(w), np.zeros_like(w)) for w in self.weights]
        self._updates = 0

    def __call__(self, inputs):
        return self._hidden(inputs) @ self.weights[2] + self.weights[3]

    def _hidden(self, inputs):
        return np.tanh(inputs @ self.weights[0] + self.weights[1])

    def descend(self, inputs, slopes):
        """Follow the gradient; `slopes` are those of the loss by each output."""
        hidden = self._hidden(inputs)
        back = slopes @ self.weights[2].T * (1 - hidden**2)
        self._adam([inputs.T @ back, back.sum(0), hidden.T @ slopes, slopes.sum(0)])

    def _adam(self, gradients):
        self._updates += 1
        for weight, gradient, (mean, square) in zip(
            self.weights, gradients, self._moments, strict=True
        ):
            mean += 0.1 * (gradient - mean)
            square += 0.001 * (gradient**2 - square)
            corrected = mean / (1 - 0.9**self._updates)
            size = np.sqrt(square / (1 - 0.999**self._updates))
            weight -= RATE * corrected / (size + 1e-8)


def episode(envs, features, policy, value, spread, random, seed):
    """One episode of all rows: inputs, actions, advantages, returns, and rewards by row."""
    observations, _ = envs.reset(seed=seed)
    limit = envs.single_action_space.high
    active, steps = np.ones(envs.num_envs, bool), []
    while active.any():
        inputs = features(observations)
        actions = policy(inputs) + spread * random.normal(size=(len(inputs), len(limit)))
        observations, rewards, terminated, truncated, _ = envs.step(np.clip(actions, -1, 1) * limit)
        following = np.where(terminated, 0.0, value(features(observations))[:, 0])
        steps.append((active, inputs, actions, rewards, following, terminated | truncated))
        active = ~(terminated | truncated)
    advantages, last = [], np.zeros(envs.num_envs)
    for _, inputs, _, rewards, following, ended in reversed(steps):
        # The factor keeps values, which are sums of discounted rewards, near those of one reward.
        error = (1 - GAMMA) * rewards + GAMMA * following - value(inputs)[:, 0]
        last = error + GAMMA * LAMBDA * last * ~ended
        advantages.append(last)
    masks, inputs, actions, rewards, _, _ = map(np.array, zip(*steps, strict=True))
    advantages = np.array(advantages[::-1])
    returns = advantages + value(inputs)[..., 0]
    return *(part[masks] for part in (inputs, actions, advantages, returns)), rewards.sum(0)


def learn(envs, features, seed, updates, spread=0.5):
    """The trained policy, and the mean sum of rewards in each episode.

    `features` makes the inputs of the networks from observations.
    """
    random = np.random.default_rng(seed)
    inputs = features(envs.reset(seed=seed)[0]).shape[1]
    policy = Network(random, inputs, len(envs.single_action_space.high))
    value, curve = Network(random, inputs, 1), []
    for _ in range(updates):
        start = int(random.integers(1 << 31))
        x, actions, advantages, returns, gained = episode(
            envs, features, policy, value, spread, random, start
        )
        curve.append(float(gained.mean()))
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        old = policy(x)
        for _ in range(EPOCHS):
            for rows in np.array_split(random.permutation(len(x)), max(1, len(x) // BATCH)):
                improve(policy, x[rows], actions[rows], old[rows], advantages[rows], spread)
                slopes = value(x[rows]) - returns[rows, None]
                value.descend(x[rows], slopes / len(rows))
        spread = max(0.1, spread * 0.97)
    return policy, curve


def improve(policy, inputs, actions, old, advantages, spread):
    """A step along the gradient of the clipped objective."""
    means = policy(inputs)
    logs = ((actions - old) ** 2 - (actions - means) ** 2).sum(1) / (2 * spread**2)
    ratios = np.exp(logs)
    # The objective is flat where the ratio has left its range in the direction of the advantage.
    free = np.where(advantages > 0, ratios < 1 + CLIP, ratios > 1 - CLIP)
    slopes = (free * ratios * advantages)[:, None] * (actions - means) / spread**2
    policy.descend(inputs, -slopes / len(inputs))
