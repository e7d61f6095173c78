"""Several worlds as a vector environment: the bits of single ones, and the end of processes."""

import os
import signal
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space
from rl_pond import ALL_FISH, Fish, pond, pond_of
from test_environments import same

from minerva_bus import MinervaError
from minerva_learning import parallel_env, population_env, single_env, vector_env

FISH = (pond, "#c", "eSwim", ["x", "food", "color"])
ROBOT = ("robot", "ARobot", "eSpeed", ["row", "grid"])
PICK = (pond, "#a", "ePick", ["color"])


def steps(envs, count):
    """Everything that an environment returns for random actions, with episodes that end."""
    envs.action_space.seed(5)
    results = [envs.reset(seed=3)]
    results += [envs.step(envs.action_space.sample()) for _ in range(count)]
    results += [digests_of(envs), envs.reset(seed=[9, None, 4, 2, 1][: envs.num_envs])]
    results += [digests_of(envs), envs.reset()]
    envs.close()
    return results


def digests_of(envs):
    return list(envs.get_attr("digest")) if isinstance(envs, SyncVectorEnv) else envs.digests


# The fish starves in its first frame, so episodes end by death and by their length.
@pytest.mark.parametrize(
    ("what", "frames", "processes"),
    [(FISH, [1, 0, 1, 0, 1], (1, 2, 5)), (PICK, [1, 2, 0, 1], (1, 2)), (ROBOT, [1, 2, 0], (2,))],
)
def test_worlds_in_processes_have_the_bits_of_single_environments(what, frames, processes):
    worlds, count = processes[-1], len(frames)
    single = steps(SyncVectorEnv([partial(single_env, *what, frames=2)] * worlds), count)
    assert [result[4]["frame"][0] for result in single[1 : 1 + count]] == frames
    for number in processes:
        envs = vector_env(*what, worlds=worlds, processes=number, frames=2)
        assert same(single, steps(envs, count))


def test_a_vector_environment_has_the_spaces_of_gymnasium():
    env, envs = single_env(*FISH), vector_env(*FISH, worlds=3, seed=8)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.observation_space == batch_space(env.observation_space, 3)
    assert envs.action_space == batch_space(env.action_space, 3)
    # Without seeds, worlds differ, from the seed of the world on.
    assert same(envs.reset(), vector_env(*FISH, worlds=3).reset(seed=8))
    envs.step(envs.action_space.sample())
    assert len(set(envs.digests)) == 3


def test_a_row_of_a_population_is_a_world_with_one_agent():
    # One starves in the first frame, one is far enough in the second, one starves in the third.
    what = {"act": "eSwim", "observe": ["x", "food"], "reward": "x", "done": "x > 3.3"}
    envs = population_env(pond, "AFish", **what)
    observed, _ = envs.reset(seed=6)
    actions = np.array([[0.5, 1.0], [0.75, 2.0], [1.0, 3.0]])
    steps = [envs.step(actions) for _ in range(3)]
    assert [step[2].tolist() for step in steps] == [[0, 0, 1], [0, 1, 1], [1, 1, 1]]
    for row, string in enumerate(ALL_FISH.split(" · ")):
        alone = single_env(pond_of(Fish, string), "AFish", **what)
        assert same(alone.reset(seed=6)[0], observed[row])
        for seen, rewards, terminated, *_ in steps[: 3 - row]:
            own = alone.step(actions[row])
            assert same(own[:3], (seen[row], rewards[row], terminated[row]))
        assert own[2]


def test_a_population_in_columns_is_a_parallel_environment():
    flock = partial(parallel_env, "flock", "ABird", "eTurn", frames=3, birds=7)
    envs, agents = population_env("flock", "ABird", "eTurn", frames=3, birds=7), flock()
    assert agents.possible_agents == envs.ids == [f"b{n}" for n in range(7)]
    observed, seen = envs.reset(seed=2)[0], agents.reset(seed=2)[0]
    while agents.agents:
        assert same(observed, np.array([seen[name] for name in envs.ids]))
        actions = envs.action_space.sample()
        observed, rewards, terminated, truncated, _ = envs.step(actions)
        seen, *_ = agents.step(dict(zip(envs.ids, actions, strict=True)))
        assert envs.digest == agents.digest
    assert (truncated.all(), terminated.any(), rewards.tolist()) == (True, False, [1.0] * 7)
    with pytest.raises(MinervaError, match=r"all episodes are over"):
        envs.step(actions)
    envs.reset()
    with pytest.raises(MinervaError, match="the action of b2: eTurn: angle must be a number"):
        envs.step(np.array([[0.0], [1.0], [40.0], [0.0], [0.0], [0.0], [0.0]]))
    with pytest.raises(MinervaError, match="several arrays; expected one"):
        population_env("robot", "ARobot", "eSpeed", ["row", "grid"])


def test_wrong_arguments_are_explained():
    with pytest.raises(MinervaError, match="worlds=2, processes=3: expected at least 1 process"):
        vector_env(*FISH, worlds=2, processes=3)
    with pytest.raises(MinervaError, match="render_mode is for single_env"):
        vector_env(*FISH, worlds=2, render_mode="svg")
    envs = vector_env(*FISH, worlds=2)
    with pytest.raises(MinervaError, match=r"call reset\(\) first"):
        envs.step([[0.0, 0.0]] * 2)
    with pytest.raises(MinervaError, match="reset: 3 seeds; expected 2, one per world"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(MinervaError, match=r"seed='seven'.*expected a whole number"):
        envs.reset(seed="seven")
    with pytest.raises(MinervaError, match="there is no option start"):
        envs.reset(options={"start": 1})
    envs.reset()
    with pytest.raises(
        MinervaError, match=r"shape \(2,\) and type float64; expected \(2, 2\) and float64"
    ):
        envs.step([0.0, 0.0])


@pytest.mark.parametrize("processes", [1, 2])
def test_an_error_names_the_world(processes):
    envs = vector_env(*FISH, worlds=3, processes=processes)
    envs.reset()
    who = "rl_pond: worker 1 with world 2: world 2" if processes == 2 else "rl_pond: world 2"
    with pytest.raises(MinervaError, match=f"^{who}: the action of c: eSwim: way must be"):
        envs.step([[0.0, 0.0], [0.0, 0.0], [7.0, 0.0]])
    with pytest.raises(MinervaError, match="the vector environment is closed"):
        envs.reset()


def workers_of(envs):
    """The ids of the processes of a vector environment."""
    return [worker.child.pid for worker in envs._worlds._workers]


def all_have_ended(pids):
    """Whether these processes have ended, and were waited for."""
    return not any(Path(f"/proc/{pid}").exists() for pid in pids)


def killed(before, after):
    os.kill(os.getpid(), signal.SIGKILL)


def failing(before, after):
    return 1 / 0


@pytest.mark.parametrize(
    ("reward", "how"),
    [
        (killed, "its process was killed by SIGKILL"),
        (failing, "ZeroDivisionError: division by zero"),
    ],
)
def test_the_end_of_a_worker_is_an_error(reward, how):
    envs = vector_env(*FISH, reward=reward, worlds=3, processes=2)
    envs.reset()
    pids = workers_of(envs)
    with pytest.raises(MinervaError, match=f"worker 0 with worlds 0 to 1: {how}") as error:
        envs.step(np.zeros((3, 2)))
    assert reward is killed or "test_vector_envs.py:" in str(error.value)
    assert all_have_ended(pids)


def interrupting(before, after):
    # One of the two processes interrupts, as one Ctrl-C does.
    with suppress(FileExistsError):
        os.close(os.open(os.environ["INTERRUPTED"], os.O_CREAT | os.O_EXCL))
        os.kill(os.getppid(), signal.SIGINT)
    signal.pause()


def test_an_interrupt_ends_the_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("INTERRUPTED", str(tmp_path / "interrupted"))
    envs = vector_env(*FISH, reward=interrupting, worlds=2, processes=2)
    envs.reset()
    pids = workers_of(envs)
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            envs.step(np.zeros((2, 2)))
    finally:
        signal.signal(signal.SIGINT, handler)
    assert all_have_ended(pids)
    envs.close()


def test_processes_end_with_their_environment():
    envs = vector_env(*FISH, worlds=2, processes=2)
    envs.reset()
    pids = workers_of(envs)
    del envs
    assert all_have_ended(pids)
