"""Proximal policy optimization (Schulman et al., 2017, arXiv:1707.06347) in numpy.

`learn` trains one policy for all rows of a `population_env`, or several for parts of them. Actions
are normal around the output of a small network; another one estimates the value of an observation.
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


class Learner:
    """A policy, an estimate of the value of observations, and the rows that they concern."""

    def __init__(self, random, rows, inputs, outputs):
        self.rows = rows
        self.policy = Network(random, inputs, outputs)
        self.value = Network(random, inputs, 1)

    def learn(self, steps, spread, random):
        """Follow the gradients; `steps` are inputs, actions, advantages and returns."""
        x, actions, advantages, returns = steps
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        old = self.policy(x)
        for _ in range(EPOCHS):
            for rows in np.array_split(random.permutation(len(x)), max(1, len(x) // BATCH)):
                improve(self.policy, x[rows], actions[rows], old[rows], advantages[rows], spread)
                slopes = self.value(x[rows]) - returns[rows, None]
                self.value.descend(x[rows], slopes / len(rows))


def outputs(learners, name, inputs):
    """The outputs of the networks with this name, a row for each row of inputs."""
    parts = [getattr(learner, name)(inputs[learner.rows]) for learner in learners]
    made = np.empty((len(inputs), parts[0].shape[1]))
    for learner, part in zip(learners, parts, strict=True):
        made[learner.rows] = part
    return made


def episode(envs, features, learners, spread, random, seed):
    """One episode of all rows.

    Returns for each step which rows took part, inputs, actions, advantages and returns, and for
    each row the sum of rewards and the last observation.
    """
    observations, _ = envs.reset(seed=seed)
    limit = envs.single_action_space.high
    active, steps = np.ones(envs.num_envs, bool), []
    while active.any():
        inputs = features(observations)
        means = outputs(learners, "policy", inputs)
        actions = means + spread * random.normal(size=(len(inputs), len(limit)))
        observations, rewards, terminated, truncated, _ = envs.step(np.clip(actions, -1, 1) * limit)
        after = outputs(learners, "value", features(observations))[:, 0]
        following = np.where(terminated, 0.0, after)
        now = outputs(learners, "value", inputs)[:, 0]
        steps.append((active, inputs, actions, rewards, now, following, terminated | truncated))
        active = ~(terminated | truncated)
    advantages, last = [], np.zeros(envs.num_envs)
    for _, _, _, rewards, now, following, ended in reversed(steps):
        # The factor keeps values, which are sums of discounted rewards, near those of one reward.
        error = (1 - GAMMA) * rewards + GAMMA * following - now
        last = error + GAMMA * LAMBDA * last * ~ended
        advantages.append(last)
    masks, inputs, actions, rewards, values, _, _ = map(np.array, zip(*steps, strict=True))
    advantages = np.array(advantages[::-1])
    made = masks, inputs, actions, advantages, advantages + values
    return made, rewards.sum(0), observations


def learn(envs, features, seed, updates, spread=0.5, teams=None):
    """The trained policies, and a row for each episode: mean sum of rewards, mean last observation.

    `features` makes the inputs of the networks from observations. `teams` are the rows of each
    learner; without them, there is one for all rows.
    """
    random = np.random.default_rng(seed)
    inputs = features(envs.reset(seed=seed)[0]).shape[1]
    size = len(envs.single_action_space.high)
    groups = [np.arange(envs.num_envs)] if teams is None else teams
    learners = [Learner(random, rows, inputs, size) for rows in groups]
    curve = []
    for _ in range(updates):
        start = int(random.integers(1 << 31))
        steps, gained, seen = episode(envs, features, learners, spread, random, start)
        curve.append([gained.mean(), *seen.mean(0)])
        for learner in learners:
            masks, *parts = (part[:, learner.rows] for part in steps)
            learner.learn([part[masks] for part in parts], spread, random)
        spread = max(0.1, spread * 0.97)
    return [learner.policy for learner in learners], np.array(curve)


def improve(policy, inputs, actions, old, advantages, spread):
    """A step along the gradient of the clipped objective."""
    means = policy(inputs)
    logs = ((actions - old) ** 2 - (actions - means) ** 2).sum(1) / (2 * spread**2)
    ratios = np.exp(logs)
    # The objective is flat where the ratio has left its range in the direction of the advantage.
    free = np.where(advantages > 0, ratios < 1 + CLIP, ratios > 1 - CLIP)
    slopes = (free * ratios * advantages)[:, None] * (actions - means) / spread**2
    policy.descend(inputs, -slopes / len(inputs))
