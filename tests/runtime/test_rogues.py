"""Clients that send forbidden messages are named, and the world continues."""

import os
from contextlib import suppress

import msgpack
import pytest
from running import ALL_KINDS, World, ends_as_alone, eventually, put, write_world

from minerva_bus.frame import messages as m
from minerva_bus.runtime.metrics import AT_ONCE
from minerva_bus.runtime.session import open_client
from minerva_bus.wire.codec import encode, stamp, stamped
from minerva_bus.wire.keys import Keys
from minerva_bus.world.services import Participation, When

NAMES = ("steps", "walkers", "water", "eye", "screen", "noise")


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = write_world(tmp_path_factory.mktemp("rogues"), ALL_KINDS, frames=0, rate=20)
    often = [word for name in NAMES for word in ("--set", f"{name}.restarts=100")]
    with World(path, *often) as world:
        world.runs(*NAMES)
        yield world


@pytest.fixture(scope="module")
def rogue(world):
    with open_client("rogue", world.endpoint()) as session:
        yield session


def epoch(session, world):
    """The epoch of the world's coordinator, as the prefix of a message."""
    (reply,) = session.liveliness().get(Keys(world.name).epoch("*"))
    return stamp(int(str(reply.ok.key_expr).rpartition("/")[2]))


def said_of(world, victim, problem, rogue, data):
    """Put the data until the log names the victim: a stalled link is closed after a second."""
    for _ in range(4):
        put(rogue, Keys(world.name).sent_by(victim), data)
        with suppress(AssertionError):
            return world.says(f"{victim} │ broke the protocol", problem, seconds=10)
    raise AssertionError(f"nothing is said of {victim}:\n{world.text}")


def goes_on(world):
    assert world.process.poll() is None, world.text
    before = eventually(lambda: world.members() and world.frame, "it answers")
    eventually(lambda: world.members() and world.frame > before + 3, "the world goes on")
    assert "the coordinator" not in world.text


GARBAGE = {
    "garbage": (b"\xc1garbage", "this is not msgpack"),
    "a foreign fragment": (
        msgpack.packb(["evolved", 1, 0, {"a": [1, ["AFox", "a", [], 0]]}, {}, {}]),
        "the vocabulary has no AFox",
    ),
    "nested lists": (b"\x91" * 1_000_000, "this is not a msgpack list that begins"),
    "nested data": (
        b"\x92\xa7emitted\x91\x92\xa5eStep\x91" + b"\x91" * 700 + b"\x01",
        "nested more",
    ),
    "more than 64 MiB": (
        msgpack.packb(["emitted", [["eWish", [1.0, "x" * (65 << 20)]]]]),
        "bytes at once, over 67108864",
    ),
    "a figure that is none": (
        msgpack.packb(["doing", {"mean": float("nan")}]),
        "figures: mean must be a finite number or text, not nan",
    ),
    "what it does not make": (
        msgpack.packb(["emitted", [["eWish", [0.0, ""]]]]),
        "but its hello declares",
    ),
}


@pytest.mark.parametrize("what", GARBAGE)
def test_a_message_in_a_members_name_is_rejected_and_the_member_rejoins(world, rogue, what):
    """The sender is not identifiable: the member is shut out, and its successor continues."""
    data, problem = GARBAGE[what]
    victim = NAMES[list(GARBAGE).index(what) % len(NAMES)]
    pid = world.runs(victim)[victim]
    line = said_of(world, victim, problem, rogue, epoch(rogue, world) + data)
    assert len(line) < 1000
    eventually(lambda: world.runs(victim)[victim] != pid, "a successor")
    goes_on(world)


@pytest.mark.parametrize("hello", [
    b"\xc1",
    encode(m.Hello("x", 99)),
    encode(m.Hello("x", 1, generates=("eRain",))),
    msgpack.packb(["hello", {"version": 3}]),
    encode(m.Hello("x", 1, generates=("eStep",), when=When(Participation.IN_STEP))).replace(b"\xa5kinds\x90",
        b"\xa5kinds\x91\x94\xa2AX\x91\x93\xa1a\xa4reel\xc0\x90\x90"),
])  # fmt: skip
def test_a_stranger_with_a_token_and_an_invalid_hello(world, rogue, hello):
    name = f"stranger-{os.urandom(3).hex()}"
    keys = Keys(world.name)
    heard = []
    listening = rogue.declare_subscriber(
        keys.to(name), lambda s: heard.append(s.payload.to_bytes())
    )
    token = rogue.liveliness().declare_token(keys.alive(name))
    eventually(lambda: heard, "it is greeted")
    assert msgpack.unpackb(stamped(heard[0])[1]) == ["greet"]
    put(rogue, keys.sent_by(name), epoch(rogue, world) + hello)
    eventually(lambda: len(heard) > 1, "it is answered")
    assert msgpack.unpackb(stamped(heard[1])[1])[0] == "refused"
    token.undeclare()
    listening.undeclare()
    goes_on(world)


@pytest.mark.parametrize("name", ["any$*", "a b", "ä"])
def test_a_stranger_with_an_invalid_name(world, rogue, name):
    keys = Keys(world.name)
    token = rogue.liveliness().declare_token(keys.alive(name))
    put(rogue, keys.sent_by(name), epoch(rogue, world) + encode(m.Leaving(name)))
    world.says("strangers │ messages of a member are ignored: a member's name has up to 64")
    token.undeclare()
    goes_on(world)
    assert name not in world.members()


def test_a_silent_stranger_delays_no_member(world, rogue):
    token = rogue.liveliness().declare_token(Keys(world.name).alive("dumb"))
    eventually(lambda: "dumb" in world.members(), "it is seen")
    goes_on(world)
    token.undeclare()
    goes_on(world)


@pytest.mark.parametrize("key", [
    "all", "tick", "evolve", "view/eShow", "topic/sight/water", "topic/sight/nobody", "to/screen",
    "to/nobody", "record", "control", "alive/steps", "alive/coordinator", "from/a/b", "from",
])  # fmt: skip
def test_garbage_on_any_other_key(world, rogue, key):
    """Members that cannot decode a coordinator message exit, and their successors continue."""
    put(rogue, f"minerva/{world.name}/{key}", b"\xc1")
    goes_on(world)


@pytest.mark.parametrize("data", [b"", b"\x00", b"\xc1"])
@pytest.mark.parametrize("name", ["coordinator", "nobody"])
def test_knocking_like_the_coordinator_itself(world, rogue, name, data):
    put(rogue, Keys(world.name).sent_by(name), data)
    goes_on(world)


def test_an_unrequested_frame_is_dropped(world, rogue):
    keys = Keys(world.name)
    late = world.members()["steps"]["late"]
    for frame in (0, 1 << 40):
        reply = encode(m.TickReply("steps", frame))
        put(rogue, keys.sent_by("steps"), epoch(rogue, world) + reply)
    eventually(lambda: world.members()["steps"]["late"] >= late + 2, "they are counted")
    goes_on(world)


def test_messages_without_an_epoch_are_rejected_and_with_another_ignored(world, rogue):
    key, data = Keys(world.name).sent_by("walkers"), encode(m.Leaving("walkers"))
    pid = world.runs("walkers")["walkers"]
    for other in (0, 7, 1 << 40):
        put(rogue, key, stamp(other) + data)
    goes_on(world)
    assert world.runs("walkers")["walkers"] == pid
    put(rogue, key, data)
    world.says("walkers │ broke the protocol: a message begins with its coordinator's epoch")
    eventually(lambda: world.runs("walkers")["walkers"] != pid, "a successor")


def test_a_flood_of_strangers_does_not_stop_the_world(world, rogue):
    for n in range(300):
        put(rogue, Keys(world.name).sent_by(f"ghost-{n}"), b"\xc1")
    goes_on(world)
    ghosts = [name for name in world.members() if name.startswith("ghost")]
    assert ghosts == []


def test_a_flapping_token_writes_few_lines(world, rogue):
    def about():
        return [line for line in world.text.splitlines() if "flutter" in line]

    for _ in range(400):
        token = rogue.liveliness().declare_token(Keys(world.name).alive("flutter"))
        token.undeclare()
    goes_on(world)
    assert len(about()) < 2 * AT_ONCE


def test_the_string_keeps_no_trace_of_it(world, tmp_path):
    """Restarted members continue from their saved state, so the digest is unaffected."""
    ends_as_alone(world)
