"""Trained policies as agents."""

import os

import numpy as np
import pytest

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")

from gymnasium import spaces
from rl_pond import Fish, ShyFish, ePick, eSwim, pond, pond_of, shy

from minerva_bus import MinervaError, run
from minerva_bus.errors import MisuseError
from minerva_learning import follow_policy, parallel_env
from minerva_learning.following import onnx_policy


def test_a_policy_acts_as_in_training():
    env = parallel_env(pond, Fish, "eSwim", ["x", "food"], frames=3)
    observations, _ = env.reset(seed=4)
    digests = []
    while env.agents:
        actions = {name: shy(observations[name]) for name in env.agents}
        observations, *_ = env.step(actions)
        digests.append(env.digest)
    env.close()
    trained = pond_of(ShyFish)
    assert run(trained, frames=2, seed=4).digest == digests[1]
    assert run(trained, frames=2, seed=4, processes=2).digest == digests[1]
    assert run(pond, frames=2, seed=4).digest != digests[1]


def test_a_policy_chooses_events():
    class Painter(Fish):
        follow = follow_policy(
            lambda seen: int(seen[-1] > 0), when="eTick", act=[None, ePick("blue", 1, True)],
            observe="eSee",
        )  # fmt: skip

    done = run(pond_of(Painter), frames=1)
    assert [agent.state["color"] for agent in done.scene] == ["blue", "blue"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"act": "eSwim"}, "expected an event type or a list of events"),
        ({"policy": lambda seen: [9.0, 0.0]}, "way must be a number from -1 to 1"),
        ({"observe": ["fod"]}, "AFish has no attribute and no view fod; did you mean 'food'?"),
        ({"policy": "missing.onnx"}, "missing.onnx: onnxruntime cannot read it"),
    ],
)
def test_mistakes_are_explained(arguments, says):
    if str(arguments.get("policy")).endswith(".onnx"):
        pytest.importorskip("onnxruntime")
    method = {"policy": shy, "when": "eTick", "act": eSwim, "observe": ["x", "food"], **arguments}
    with pytest.raises(MinervaError) as caught:
        run(pond_of(type("Wrong", (Fish,), {"follow": follow_policy(**method)})), frames=1)
    assert says in str(caught.value)


def test_a_policy_is_an_onnx_file(tmp_path):
    pytest.importorskip("onnxruntime")
    onnx = pytest.importorskip("onnx")
    # Products by powers of two are exact: processors that add before they round give the same sum.
    weights = np.array([[0.125, 0.0], [-0.0625, 2.0]], np.float32)
    double, helper = onnx.TensorProto.FLOAT, onnx.helper
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["seen", "weights"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("seen", double, [None, 2])],
        [helper.make_tensor_value_info("action", double, [None, 2])],
        [onnx.numpy_helper.from_array(weights, "weights")],
    )
    path = tmp_path / "policy.onnx"
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(made, path)
    with pytest.raises(MisuseError, match=r"no action for an observation of shape \(3,\): "):
        onnx_policy(path, spaces.Box(-1, 1, (2,)))(np.zeros(3))
    made.graph.input.append(helper.make_tensor_value_info("more", double, [None, 2]))
    onnx.save(made, tmp_path / "two")
    os.mkfifo(tmp_path / "pipe")
    for name, problem in (
        ("two", "its inputs are seen: .*, more: .*; expected one"),
        ("pipe", "a pipe"),
    ):
        with pytest.raises(MisuseError, match=problem):
            onnx_policy(tmp_path / name, spaces.Box(-1, 1, (2,)))

    class Read(Fish):
        follow = follow_policy(path, when="eTick", act=eSwim, observe=["x", "food"])

    class Computed(Fish):
        follow = follow_policy(
            lambda seen: seen.astype(np.float32) @ weights,
            when="eTick", act=eSwim, observe=["x", "food"],
        )  # fmt: skip

    assert run(pond_of(Read), frames=2).digest == run(pond_of(Computed), frames=2).digest
