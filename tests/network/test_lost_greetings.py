"""A member that is visible before it subscribes is greeted repeatedly."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "runtime"))
from running import MEMBERS, World, eventually, write_world

from minerva_bus.frame import messages as m
from minerva_bus.runtime.session import open_client
from minerva_bus.wire.codec import Decoder, stamped
from minerva_bus.wire.keys import Keys


def test_a_member_visible_before_it_subscribes_is_greeted(tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=0, rate=20)
    keys, heard = Keys(path.stem), []
    with World(path) as world:
        world.runs("steps", "walkers")
        with open_client("late", world.endpoint()) as session:
            token = session.liveliness().declare_token(keys.alive("late"))
            eventually(lambda: "late" in world.members(), "it is seen")
            kept = session.declare_subscriber(
                keys.to("late"), lambda sample: heard.append(stamped(sample.payload.to_bytes())[1])
            )
            eventually(lambda: heard, "it is greeted")
            assert isinstance(Decoder().to_member(heard[0]), m.Greet)
            kept.undeclare()
            token.undeclare()
