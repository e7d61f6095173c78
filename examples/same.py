"""The same world three times: in one process, in twenty, and in twenty of which some are killed.

Each run prints the digest of its last string. Digests are equal if and only if the strings are.
"""

import os
import signal

from minerva_bus import World, run

FRAMES = 100
world = World.load("meadow")  # rabbits and foxes that are born, hunt, warn each other and die

alone = run(world, frames=FRAMES, seed=7)
print(f"{alone.digest}  1 process")

# Six processes for each of three kinds of agents, two generators, and the coordinator.
apart = run(world, frames=FRAMES, seed=7, processes=6)
print(f"{apart.digest}  20 processes and their coordinator")

killed = []
with world.start(seed=7, processes=6) as live:
    while live.frame < FRAMES:
        live.step(10)
        members = live.status.members
        victim = members[(7 * len(killed)) % len(members)]
        if live.frame < FRAMES:
            os.kill(victim.pid, signal.SIGKILL)
            killed.append(victim.name)
    print(f"{live.digest}  the same, and {len(killed)} of them are killed: {', '.join(killed)}")
