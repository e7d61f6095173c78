"""Former names of modules, so that existing worlds and scripts keep working.

A former name imports the module at its new name, with a DeprecationWarning.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Final

MOVED: Final = {
    "minerva_bus.testing.telling": "minerva_bus.testing.trace_lines",
    "minerva_bus.world.acl": "minerva_bus.acl",
    "minerva_bus.record": "minerva_bus.log",
    "minerva_bus.world.moment": "minerva_bus.world.context",
    "minerva_bus.world.poses": "minerva_bus.semantics.poses",
    "minerva_bus.world.chance": "minerva_bus.world.rng",
    "minerva_services.opengl": "minerva_services.views.opengl",
    "minerva_services.sprites": "minerva_services.views.sprites",
    "minerva_services.svg": "minerva_services.views.svg",
    "minerva_services.web": "minerva_services.views.web",
    "minerva_services.window": "minerva_services.views.window",
    "minerva_services.sound": "minerva_services.views.sound",
    "minerva_services.laser": "minerva_services.sensors.laser",
    "minerva_services.camera": "minerva_services.sensors.camera",
    "minerva_services.rplidar": "minerva_services.sensors.rplidar",
    "minerva_services.nmea": "minerva_services.sensors.nmea",
    "minerva_services.serial_line": "minerva_services.sensors.serial_line",
    "minerva_services.carmen": "minerva_services.sensors.carmen",
    "minerva_services.vision": "minerva_services.sensors.vision",
    "minerva_services.playing": "minerva_services.sensors.playback",
    "minerva_services.making": "minerva_services.event_factory",
    "minerva_services.neighbours": "minerva_services.physics.neighbours",
    "minerva_services.collisions": "minerva_services.physics.collisions",
    "minerva_services.colliding": "minerva_services.physics.collision_events",
    "minerva_services.mqtt": "minerva_services.bridges.mqtt",
    "minerva_services.ros2": "minerva_services.bridges.ros2",
    "minerva_services.ros_messages": "minerva_services.bridges.ros_messages",
    "minerva_services.rosbag": "minerva_services.bridges.rosbag",
    "minerva_services.spade": "minerva_services.bridges.spade",
    "minerva_services.keyboard": "minerva_services.input.keyboard",
    "minerva_services.gamepad": "minerva_services.input.gamepad",
    "minerva_services.controls": "minerva_services.input.controls",
    "minerva_services.orders": "minerva_services.input.orders",
    "minerva_services.each": "minerva_services.input.each",
}
"""Former name to new name; it applies to the modules inside too."""


def new_name(name: str) -> str | None:
    """New name of a module, or None if `name` is not a former one."""
    for old, new in MOVED.items():
        if name == old or name.startswith(f"{old}."):
            return new + name[len(old) :]
    return None


class _Alias:
    """Loads the module at its new name in place of one at its former name."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_module(self._name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec  # The import system has set the former name.


class _MovedFinder:
    """Finds modules by their former names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        name = new_name(fullname)
        if name is None:
            return None
        import warnings

        warnings.warn(f"{fullname} is now {name}", DeprecationWarning, stacklevel=2)
        return ModuleSpec(fullname, _Alias(name))  # pyright: ignore[reportArgumentType]


def install() -> None:
    """Make former names importable.

    The finder comes first: by the path of a package at its former name, the usual finder would
    load the modules inside a second time.
    """
    if not any(isinstance(finder, _MovedFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _MovedFinder())
