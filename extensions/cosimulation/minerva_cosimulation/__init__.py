"""Worlds in co-simulations, where another program controls the time.

    stepped = SteppedWorld("house.toml", seed=7)
    stepped.set("eHeat.watts", 1000.0)
    stepped.step()
    print(stepped.get("room.celsius"))

`minerva_cosimulation.mosaik` is the same as a simulator of mosaik,
`minerva_cosimulation.helics` as a federate of HELICS, and `minerva_cosimulation.fmi` writes
a world as an FMU of FMI 3.
"""

from minerva_cosimulation.stepped_world import SteppedWorld

__all__ = ["SteppedWorld"]
