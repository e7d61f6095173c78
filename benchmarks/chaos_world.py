"""The world file of benchmarks/chaos.py: a colony with one coordinator, or divided into regions."""

from __future__ import annotations

from dataclasses import dataclass

NAME = "colony"
ANTS = 200
WORLD = """
[world]
name = "{name}"
string = '''{string}'''
vocabulary = "benchmarks.models.colony:vocabulary"
seed = {seed}
dt = 0.1

[bus]
soft = 3.0
hard = 60.0
"""
PROCESSES = {
    "steps": 'service = "benchmarks.models.colony:Steps"',
    "weather": 'service = "benchmarks.models.colony:Weather"',
    "ground": 'service = "benchmarks.models.colony:Ground"',
    "screen": 'service = "benchmarks.models.colony:Screen"',
    "seasons": 'service = "benchmarks.models.colony:Seasons"',
    "ants": 'agents = "benchmarks.models.colony:Ant"\nprocesses = {hosts}',
}
HOSTS = 4
"""Of a world with one coordinator."""
WIDTH = 50.0
"""Of the ground, metres: regions have equal parts of it."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How the world is divided: into `regions` (0: not at all), each with so many `hosts`.

    Regions run `lag` frames ahead; then agents move every `move_every` frames.
    """

    regions: int = 0
    lag: int = 0
    move_every: int = 1
    hosts: int = 0


def world_text(seed: int, layout: Layout) -> str:
    """The world file."""
    ants = " · ".join(f"AAnt#a{n}<x={n % 50}, y={n // 5}>" for n in range(ANTS))
    # A view that only an observer wants is not an event of frames without it.
    absent = ("ground", "screen") if layout.lag else ("seasons",)
    hosts = layout.hosts or HOSTS
    parts = [
        f"[process.{name}]\n{text.format(hosts=hosts)}\nrestarts = 1000000\n"
        for name, text in PROCESSES.items()
        if name not in absent
    ]
    regions = layout.regions
    if regions:
        borders = [WIDTH * number / regions for number in range(1, regions)]
        parts.append(f"[regions]\ngrid = {{ x = {borders} }}\n")
    if layout.hosts:
        parts.append('hosts = ["ants"]\n')
    if layout.lag:
        parts.append(f"lag = {layout.lag}\nmove_every = {layout.move_every}\n")
    return WORLD.format(name=NAME, string=ants, seed=seed) + "\n" + "\n".join(parts)
