"""The world file of checks/chaos.py: a colony."""

from __future__ import annotations

NAME = "colony"
ANTS = 200
WORLD = """
[world]
name = "{name}"
string = '''{string}'''
vocabulary = "checks.colony:vocabulary"
seed = {seed}
dt = 0.1

[bus]
soft = 3.0
hard = 60.0
"""
PROCESSES = {
    "steps": 'service = "checks.colony:Steps"',
    "weather": 'service = "checks.colony:Weather"',
    "ground": 'service = "checks.colony:Ground"',
    "screen": 'service = "checks.colony:Screen"',
    "ants": 'agents = "checks.colony:Ant"\nprocesses = {hosts}',
}
HOSTS = 4
"""Processes of ants."""


def world_text(seed: int) -> str:
    """The world file."""
    ants = " · ".join(f"AAnt#a{n}<x={n % 50}, y={n // 5}>" for n in range(ANTS))
    parts = [
        f"[process.{name}]\n{text.format(hosts=HOSTS)}\nrestarts = 1000000\n"
        for name, text in PROCESSES.items()
    ]
    return WORLD.format(name=NAME, string=ants, seed=seed) + "\n" + "\n".join(parts)
