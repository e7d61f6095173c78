"""Worlds as environments of PettingZoo and Gymnasium."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
)
from pettingzoo.utils import parallel_to_aec
from rl_pond import Fish, eEat, ePick, eSwim, eTick, pond

from minerva_bus import MinervaError, World, run
from minerva_bus.grammar.events import single
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene
from minerva_learning import parallel_env, single_env
from minerva_worlds.flock.flock import eTurn

LIGHTS = World.load("traffic", cars=4)
eLight = LIGHTS.vocabulary.events["eLight"]
FLOCK = World.load("flock", birds=6)
SHIPPED = {
    "robot": ("robot", "ARobot", "eSpeed", ["row", "column", "angle", "grid"]),
    "meadow": ("meadow", "ARabbit", "eAlarm", ["x", "y", "energy", "fear"]),
    "traffic": (LIGHTS, "ACar", [None, eLight("green", "green"), eLight("red", "red")], None),
    "flock": (FLOCK, "ABird", "eTurn", None),
}


def shipped(name, **settings):
    world, kind, act, observe = SHIPPED[name]
    return parallel_env(world, kind, act, observe, frames=4, **settings)


def episode(env, seed=None):
    """Everything that an episode with random actions returns."""
    observations, infos = env.reset(seed)
    steps = [(observations, infos, env.digest)]
    while env.agents:
        for number, agent in enumerate(env.agents):
            env.action_space(agent).seed(100 * len(steps) + number)
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        steps.append((*env.step(actions), env.digest))
        assert all(
            env.observation_space(name).contains(seen) for name, seen in steps[-1][0].items()
        )
    env.close()
    return steps


def same(one_part, other):
    """Whether two results are equal, bit by bit."""
    if isinstance(one_part, dict):
        return one_part.keys() == other.keys() and all(same(one_part[k], other[k]) for k in other)
    if isinstance(one_part, tuple | list):
        return len(one_part) == len(other) and all(map(same, one_part, other))
    one_array, two = np.asarray(one_part), np.asarray(other)
    # The bytes of an array of objects are addresses.
    if one_array.dtype == object:
        return one_array.tolist() == two.tolist()
    return one_array.dtype == two.dtype and one_array.tobytes() == two.tobytes()


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_world_passes_the_tests_of_pettingzoo(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Kinds with births have no possible_agents.
        parallel_api_test(shipped(name), num_cycles=6)
        parallel_seed_test(lambda: shipped(name), num_cycles=6)
    # The seed test of PettingZoo ends after one step.
    env = shipped(name)
    first = episode(env, seed=5)
    assert len(first) == 5
    assert same(first, episode(env, seed=5))


def test_agents_that_act_in_turns_pass_the_tests_of_pettingzoo():
    def flock(max_cycles=8, render_mode=None):
        # The test of pictures begins with a window, which an environment does not have.
        mode = None if render_mode == "human" else render_mode
        return parallel_env(FLOCK, "ABird", "eTurn", frames=max_cycles, render_mode=mode)

    def turns(**given):
        return parallel_to_aec(flock(**given))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        api_test(turns(), num_cycles=40)
        seed_test(turns, num_cycles=6)
        max_cycles_test(SimpleNamespace(env=turns, parallel_env=flock))
        render_test(turns)


def test_one_agent_passes_the_test_of_gymnasium():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # It recommends spaces with limits.
        check_env(single_env("robot", "ARobot", "eSpeed", ["row", "angle"], frames=3))
        check_env(single_env("flock", "#b3", "eTurn", frames=3, birds=6, render_mode="rgb_array"))
        check_env(single_env(LIGHTS, "#c1", SHIPPED["traffic"][2], frames=3, render_mode="ansi"))
        check_env(single_env("meadow", "#r1", "eAlarm", frames=3))


def test_processes_and_running_worlds_give_the_same_bits():
    make = {"agents": Fish, "act": "eSwim", "observe": ["x", "food", "color"], "frames": 5}
    here = episode(parallel_env(pond, **make), seed=3)
    with pond.start(seed=3, rate=0.0) as live:
        assert same(here, episode(parallel_env(live, **make)))
        with pytest.raises(MinervaError, match="keeps its seed"):
            parallel_env(live, **make).reset(seed=1)
    assert same(here, episode(parallel_env(pond, processes=2, **make), seed=3))


def test_an_environment_runs_the_frames_of_the_world():
    env = parallel_env(pond, Fish, "eSwim", frames=2, every=2)
    _, infos = env.reset(seed=9)
    assert infos["a"] == {"frame": 0}
    results = env.step({})
    assert results[4]["a"] == {"frame": 2}
    assert env.digest == run(pond, frames=2, seed=9).digest
    # c has starved.
    assert results[2:4] == ({"a": False, "b": False, "c": True}, {"a": True, "b": True, "c": False})
    assert env.agents == []
    # Further episodes have other seeds, which follow from the last one.
    first = env.digest
    digests = [env.reset() and env.step({}) and env.digest for _ in range(2)]
    env.reset(seed=9)
    assert digests == [env.reset() and env.step({}) and env.digest for _ in range(2)]
    assert len({first, *digests}) == 3


def test_a_digest_is_computed_when_it_is_read(monkeypatch):
    env = parallel_env(pond, Fish, "eSwim", frames=9)
    env.reset(seed=9)
    assert env.digest == pond.scene.digest.hex()
    with monkeypatch.context() as patched:
        patched.setattr(Scene, "digest", property(lambda scene: pytest.fail("nobody reads it")))
        env.step({})
    assert env.digest == run(pond, frames=1, seed=9).digest


def test_numbers_of_numpy_are_seeds_and_options():
    given = [parallel_env("flock", "ABird", "eTurn", birds=birds, frames=frames, seed=seed)
             for birds, frames, seed in ((2, 3, 5), (np.int64(2), np.int32(3), np.uint8(5)))]  # fmt: skip
    first, second = map(episode, given)
    assert same(first, second)
    assert len(first) == 4
    env = parallel_env(pond, Fish, "eSwim", frames=2)
    assert same(episode(env, seed=np.int64(9)), episode(env, seed=9))
    with pytest.raises(MinervaError, match=r"reset\(seed=2\.5\): expected a whole number"):
        env.reset(seed=2.5)
    done = [run(pond, frames=2, seed=seed).digest for seed in (4, np.int64(4), 5)]
    assert done[0] == done[1] != done[2]


def test_a_reward_that_is_no_number_is_explained():
    env = parallel_env(pond, Fish, "eEat", reward=lambda before, after: None)
    env.reset()
    with pytest.raises(MinervaError, match="returned None for a; expected a number"):
        env.step({})


def test_agents_are_born_and_die():
    env = parallel_env(pond, Fish, eEat(), "food", reward="food", done="food == 2")
    observations, _ = env.reset()
    assert not hasattr(env, "possible_agents")
    assert env.action_space("a") == spaces.Discrete(2)
    observations, rewards, terminations, _, infos = env.step({"b": 1, "a": 0})
    newborn = (observations.keys() - {"a", "b", "c"}).pop()
    # c starves: its last observation remains. b gives birth; both end by the condition, as a does.
    assert observations["c"] == [1.0]
    assert terminations == {"a": True, "b": True, "c": True, newborn: True}
    assert rewards == {"a": -1.0, "b": -1.0, "c": 0.0, newborn: 0.0}
    assert infos.keys() == terminations.keys()
    assert env.agents == []
    with pytest.raises(MinervaError, match="no agent a to act"):
        env.step({"a": 1})

    env = parallel_env(pond, Fish, eEat(), births=False)
    assert env.possible_agents == ["a", "b", "c"]
    env.reset()
    _, rewards, *_ = env.step({"b": 1})
    assert rewards == {"a": 1.0, "b": 1.0, "c": 0.0}
    assert env.agents == ["a", "b"]


@pytest.mark.parametrize(
    ("act", "space", "action", "data"),
    [
        ("eSwim", spaces.Box(np.array([-1, -np.inf]), np.array([1, np.inf]), dtype=np.float64),
         np.array([0.1, 2.0], np.float32), (float(np.float32(0.1)), 2.0)),
        ("ePick", spaces.MultiDiscrete([3, 3, 2]), np.array([1, 0, 1]), ("green", 1, True)),
        ([None, ePick("blue", 2, False)], spaces.Discrete(2), np.int64(1), ("blue", 2, False)),
        ("eEat", spaces.Discrete(2), 1, ()),
        ("eEat", spaces.Discrete(2), 0, None),
    ],
)  # fmt: skip
def test_spaces_of_actions_follow_from_the_vocabulary(act, space, action, data):
    env = parallel_env(pond, Fish, act)
    assert env.action_space("a") == space
    acting = env._episode.task.acting
    event = acting.event("a", action)
    assert event is None if data is None else (event.values, event.receivers) == (data, ("a",))
    both = [
        (each.values, each.receivers)
        for each in single(acting.events(Ids.of(["c", "a"]), [action, action]))
    ]
    assert both == ([] if data is None else [(data, ("c",)), (data, ("a",))])


def test_choices_of_several_types_are_a_batch_for_each():
    acting = parallel_env(
        pond, Fish, [None, ePick("blue", 2, False), eEat(), ePick("red", 1, True)]
    )
    acting = acting._episode.task.acting
    ids = ["a", "b", "c", "a", "b"]
    batches = acting.events(Ids.of(ids), np.array([3, 0, 1, 2, 1]))
    assert [[(each.values, *each.receivers) for each in batch] for batch in batches] == [
        [(("red", 1, True), "a"), (("blue", 2, False), "c"), (("blue", 2, False), "b")],
        [((), "a")],
    ]
    with pytest.raises(MinervaError, match=r"the action of c is 4; expected a number from 0 to 3"):
        acting.events(Ids.of(ids), np.array([3, 0, 4, 2, 1]))


def test_spaces_of_observations_follow_from_the_vocabulary():
    env = parallel_env(pond, Fish, "eEat", ["color", "big", Fish.x, "tail"])
    assert env.reset()[0]["b"].tolist() == [1, 0, 0, 0, 2, 0.5, 1.5]
    space = env.observation_space("b")
    assert space.low.tolist() == [0, 0, 0, 0, -np.inf, -np.inf, -np.inf]
    assert parallel_env(pond, Fish, "eEat", "eSee").reset()[0]["b"].tolist() == [2, 3, 0.5, 1.5]

    def pair(string, agent):
        return [[len(string), agent.state["x"]]]

    assert parallel_env(pond, Fish, "eEat", pair).reset()[0]["b"].tolist() == [[3, 2]]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"agents": "AFisch"}, "no agent kind AFisch; did you mean 'AFish'?"),
        ({"agents": "#d"}, "no agent #d"),
        ({"act": "eSee"}, "AFish does not respond to eSee; it responds to eEat"),
        ({"act": "eEatt"}, "no event type eEatt; did you mean 'eEat'?"),
        ({"act": "eMix"}, "note of eMix is a text, which cannot be an action"),
        (
            {"act": [None, eTick()]},
            "eTick, so people may not send it; to let them, write people = [",
        ),
        ({"act": []}, "the list is empty"),
        ({"observe": ["fod"]}, "no attribute and no view fod; did you mean 'food'?"),
        ({"observe": lambda string, agent: "no"}, "the observation of a is 'no'"),
        ({"reward": "colr"}, "no number colr; did you mean 'color'?"),
        ({"done": "fod > 1"}, "AFish has no fod; did you mean 'food'?"),
        ({"render_mode": "ansy"}, "'ansy'; did you mean 'ansi'?"),
        ({"every": 0}, "every=0"),
    ],
)
def test_wrong_arguments_are_explained(arguments, says):
    with pytest.raises(MinervaError) as caught:
        parallel_env(pond, **{"agents": "AFish", "act": "eEat", **arguments})
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("act", "action", "says"),
    [
        ("eSwim", [2.0, 0.0], "the action of a: eSwim: way must be a number from -1 to 1"),
        ("eSwim", [0.5], "expected 2 values: way, turn of eSwim"),
        ("eSwim", [0.5, np.nan], "turn must be a finite number in deg"),
        ("ePick", [3, 0, 0], "the action of a is 3; expected a number from 0 to 2"),
        ("eEat", 0.5, "the action of a is 0.5; expected a number from 0 to 1"),
    ],
)
def test_wrong_actions_are_explained(act, action, says):
    env = parallel_env(pond, Fish, act)
    with pytest.raises(MinervaError, match=r"call reset\(\) first"):
        env.step({})
    env.reset()
    with pytest.raises(MinervaError) as caught:
        env.step({"a": action})
    assert says in str(caught.value)
    env.close()


@pytest.mark.parametrize(
    ("world", "batch"),
    [
        (pond, eSwim(np.array([0.1, 0.2, 0.3]), 1.0, receivers=Ids.of(["c", "a", "a"]))),
        (FLOCK, eTurn(np.arange(6.0), receivers=Ids.numbered("b", range(6)))),
    ],
)  # fmt: skip
def test_a_batch_of_events_equals_its_events(world, batch, capfd):
    with world.start(seed=2) as first, world.start(seed=2) as other:
        first.publish(batch)
        for event in batch:
            other.publish(event)
        assert [first.step(), first.digest] == [other.step(), other.digest]
        assert first.digest != run(world, frames=1, seed=2).digest
        with pytest.raises(MinervaError, match="there is no agent #z; there are"):
            first.publish(replace(batch, receivers=Ids.of(["z"] * len(batch))))
    # A program that sends events knows that they count.
    assert capfd.readouterr().err == ""
