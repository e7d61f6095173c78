"""Rapier as WebAssembly: the same bits on every processor, and what it lacks."""

import hashlib

import numpy as np
import pytest

pytest.importorskip("rapier3d", reason="needs the extra space")
pytest.importorskip("wasmtime", reason="needs the extra wasm")

from minerva_bodies import Matter, wasm
from minerva_bodies.engine import Engine
from minerva_bodies.errors import BodiesError
from minerva_bodies.service import RigidBodies

pytestmark = pytest.mark.timeout(400)  # The first use compiles: 10 s of a core that is free.

HERE = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
FORMS = (("box", 0.2, 0.1, 0.1), ("ball", 0.15), ("cylinder", 0.1, 0.1), ("capsule", 0.1, 0.1))
FORMS += (("cone", 0.1, 0.1),)
NAMES = [f"b{number}" for number in range(40)]


@pytest.fixture
def needs_file():
    try:
        wasm.read_code()
    except BodiesError as error:
        pytest.skip(str(error))


def solid(form, *sizes, **material):
    return [form, list(Matter(**material).measures), list(sizes), HERE]


def pile(kind):
    """Forms of each kind that fall on a plate and on each other; two of them at a joint."""
    engine = kind(9.81, 0.01, 1)
    engine.add("", [HERE, [solid("box", 9.0, 9.0, 0.5, fixed=True)]])
    for number, name in enumerate(NAMES):
        place = [0.45 * (number % 5), 0.4 * (number // 5 % 2), 0.8 + 0.3 * (number // 10)]
        place += HERE[3:]
        engine.add(name, [place, [solid(*FORMS[number % len(FORMS)], restitution=0.2)]])
    motor = [0.0, 0.0, 1.0, -90.0, 90.0, 30.0, 50.0, 0.0, 5.0]
    engine.join("hinge", ["revolute", ["b0", "b1"], [0.0, 0.0, 1.0, *HERE[3:]], motor])
    engine.command("b3", "velocity", 1.0, 0.0, 0.0)
    engine.command("b4", "impulse", 1.0, 0.0, 0.0)
    return engine


def advance(engine, frames):
    for _ in range(frames):
        engine.step(1)
    engine.contacts()
    return engine


def test_a_pile_has_the_same_bits_on_every_processor(needs_file):
    engine = advance(pile(wasm.WasmEngine), 150)
    words = hashlib.sha256(engine.rows(NAMES).tobytes() + repr(engine.touching).encode())
    assert words.hexdigest()[:16] == "5b490abcba9c3d85"
    other = wasm.WasmEngine(9.81, 0.01, 1)
    third = wasm.WasmEngine(9.81, 0.01, 1)
    for made in (other, third):
        made.continue_from(engine.kept())
    assert np.array_equal(advance(other, 20).rows(NAMES), advance(third, 20).rows(NAMES))


def test_it_agrees_with_the_library(needs_file):
    left, right = advance(pile(Engine), 30), advance(pile(wasm.WasmEngine), 30)
    assert np.allclose(left.rows(NAMES)[:, :7], right.rows(NAMES)[:, :7], atol=0.01)
    assert left.touching.keys() == right.touching.keys()
    total = [sum(impulse for impulse, _ in engine.touching.values()) for engine in (left, right)]
    assert total[0] == pytest.approx(total[1], rel=0.1)
    assert left.positions(["hinge"]) == pytest.approx(right.positions(["hinge"]), abs=0.1)


def test_what_it_lacks_is_an_error(needs_file):
    engine = wasm.WasmEngine(9.81, 0.01, 1)
    with pytest.raises(BodiesError, match="group 20; the engine wasm has 1 to 15"):
        engine.add("a", [HERE, [solid("ball", 1.0, group=20)]])
    engine.add("b", [HERE, [solid("ball", 1e-6, density=1e-12)]])
    engine.command("b", "velocity", 3e38, 0.0, 0.0)
    with pytest.raises(BodiesError, match="the body of 'b' has no finite position"):
        advance(engine, 3)
    with pytest.raises(BodiesError, match="one thread and no rays"):
        RigidBodies(engine="wasm", threads=2)


def test_a_file_that_is_missing_or_another_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    with pytest.raises(BodiesError, match=r"No such file .*; run: npm install --prefix"):
        wasm.read_code()
    folder = tmp_path / "node_modules" / wasm.PACKAGE
    folder.mkdir(parents=True)
    (folder / "rapier_wasm3d_bg.wasm").write_bytes(b"another")
    with pytest.raises(BodiesError, match=r"is not that of version 0\.21\.0; run: npm"):
        wasm.read_code()
    with pytest.raises(BodiesError, match="engine is 'bullet'; expected rapier3d or wasm"):
        RigidBodies(engine="bullet")
