"""Worlds as FMUs of FMI 3, which any importer with Python steps: https://fmi-standard.org.

    export_fmu("house.toml", "house.fmu", inputs=["room.eHeat.watts"], outputs=["room.celsius"])

An FMU has the world file and its modules, but not Python: the importer, such as FMPy, must run in a
Python with Minerva Bus.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from zipfile import ZipFile

from pythonfmu3 import FmuBuilder  # pyright: ignore[reportMissingTypeStubs]

from minerva_bus.api.world import world_of
from minerva_bus.errors import MisuseError
from minerva_bus.files import MARK, check_ending, check_output, write_output
from minerva_bus.grammar.fields import Field
from minerva_cosimulation.stepped_world import SteppedWorld
from minerva_cosimulation.world_slave import DESCRIPTION, STARTS

TYPES: Final = {"real": "Float64", "int": "Int64", "bool": "Boolean", "text": "String"}
"""Types of FMI variables, by the kind of a value."""
_SCRIPT: Final = """\
from minerva_cosimulation.world_slave import Fmi3Slave, WorldSlave


class {name}(WorldSlave, Fmi3Slave):
    pass
"""


def export_fmu(
    world: str | Path,
    path: str | Path,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    seed: int | None = None,
    **options: Any,
) -> Path:
    """Write a world as an FMU for co-simulation.

    Args:
        world: a world file, or the name of an installed world. The FMU contains the world file with
            the Python files of its folder; an installed world must be installed where it runs.
        path: the file, .fmu.
        inputs: data of events, as for `SteppedWorld`.
        outputs: attributes of agents, as for `SteppedWorld`.
        seed: of all random numbers; default: the world's own.
        options: the world's own options: bools, numbers and texts.

    Returns:
        The file. A further output, `digest`, is the digest of the string in hexadecimal.

    Raises MinervaError if the world cannot start, and for variables that it does not have.

    """
    path = Path(path)
    check_ending(path, (".fmu",), "fmu")
    if not path.stem.isidentifier():
        raise MisuseError(f"fmu: path is {str(path)!r}; expected a name such as house.fmu")
    check_output(path, "fmu")
    dt = world_of(world, options).read().world.dt
    with SteppedWorld(world, seed, **options) as stepped:
        variables = [_described(name, stepped.input_field(name), "input") for name in inputs]
        variables += [_described(name, stepped.output_field(name), "output") for name in outputs]
    file = Path(world)
    bundled = file.is_file()
    description = {
        "world": file.name if bundled else str(world),
        "bundled": bundled,
        "dt": dt,
        "seed": seed,
        "options": options,
        "variables": variables,
    }
    modules = [file, *sorted(file.parent.glob("*.py"))] if bundled else []
    write_output(path, _built(path.stem, description, modules), "fmu")
    return path


def _described(name: str, field: Field, causality: str) -> dict[str, Any]:
    if field.type.kind not in TYPES:
        raise MisuseError(
            f"fmu: {name} is a {field.type}; expected a real or whole number, a bool, or a text"
        )
    kind = TYPES[field.type.kind]
    start = STARTS[kind] if field.default is None else field.default
    return {"name": name, "type": kind, "causality": causality, "start": start}


def _built(name: str, description: dict[str, Any], modules: Sequence[Path]) -> bytes:
    """The content of the FMU."""
    with tempfile.TemporaryDirectory(prefix="minerva-fmu-") as folder:
        script = Path(folder, f"{name}_slave.py")
        script.write_text(_SCRIPT.format(name=name), encoding="utf-8")
        described = Path(folder, DESCRIPTION)
        described.write_text(json.dumps(description, indent=1), encoding="utf-8")
        built = FmuBuilder.build_FMU(  # pyright: ignore[reportUnknownMemberType]
            script, dest=folder, project_files=[described, *modules]
        )
        with ZipFile(built, "a") as archive:
            archive.comment = MARK.encode()
        return built.read_bytes()
