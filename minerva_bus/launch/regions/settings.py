"""The table [regions] of a world file, and what a world that runs as regions cannot contain."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any, Final, cast

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.launch.specs import load
from minerva_bus.launch.table import Table
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.regions.attached import beside, is_attached
from minerva_bus.regions.halo_services import halo_services
from minerva_bus.regions.lag import RegionLag
from minerva_bus.regions.partition import ByFunction, ById, ByPosition, Partition
from minerva_bus.regions.tree import ByTree, Split
from minerva_bus.settings.declaring import settings_of
from minerva_bus.settings.tables import MAX_REGIONS, RegionSettings
from minerva_bus.world.halo import Halo
from minerva_bus.world.policy import Policy
from minerva_bus.world.services import Device, Generator, Service

_PARTS: Final = "below", "above"
"""Keys of the parts of a split, beside the attribute."""

_INSTEAD: Final = "run it with one coordinator (--regions 0); its string is the same"


def read_regions(top: Table, path: Path) -> tuple[Partition | None, RegionLag | None]:
    """The regions of a world file and command line, and the lag between them.

    Without regions, the world has one coordinator, which applies the lag, too. Raises
    WorldFileError.
    """
    settings, table = top.read(RegionSettings), top.table("regions")
    is_off = "regions" in top.overrides.values and not settings.count  # --regions 0
    if is_off and not settings.lag and settings.move_every == 1:
        return None, None
    if is_off:  # The lag is that between the regions of the file.
        count = settings_of(RegionSettings)["count"]
        settings = replace(settings, count=table.get(count.key, count.kind, count.default))
    partition = _partition(top, table, settings, path)
    lag = _lag(table, settings, partition)
    return None if is_off else partition, lag


def read_hosts(top: Table, processes: Iterable[Process]) -> tuple[str, ...]:
    """The tables of agents that have processes of their own in each region. Raises WorldFileError.

    What a command does is only known from its hello: a region refuses it if it has no agents.
    """
    hosts, tables = top.read(RegionSettings).hosts, dict[str, None]()
    for process in processes:
        if process.agents or process.command:
            tables[process.table] = None
    for name in hosts:
        if name not in tables:
            known = [*tables]
            hint = nearest(name, known, f"agents and commands: {', '.join(known) or 'none'}")
            top.table("regions").wrong("hosts", f"names no process of agents, {name!r}{hint}")
    return hosts


def _lag(table: Table, settings: RegionSettings, partition: Partition | None) -> RegionLag | None:
    if not settings.lag:
        if settings.move_every > 1:
            table.wrong("move_every", "lets regions run ahead by the lag between them: add lag")
        return None
    if partition is None:
        table.wrong("lag", "is between regions: add count, grid or tree")
    if settings.balance:
        text = "needs borders that stay where they are, since they decide which events wait"
        table.wrong("lag", f"{text}: remove balance")
    if settings.function:
        text = "needs regions by id, grid or tree, which records contain and can compute again"
        table.wrong("lag", f"{text}: remove function")
    if settings.move_every > 1 and (settings.reach != "everywhere" or settings.halo):
        # Agents may be elsewhere than in the region that runs them.
        table.wrong("move_every", 'needs reach = "everywhere", and no halo')
    if isinstance(partition, ByPosition | ByTree):  # A record continues with or without halos.
        partition = replace(partition, halo=False)
    lag = RegionLag(settings.lag, partition, settings.move_every)
    return lag if partition.count > 1 else None


def _partition(top: Table, table: Table, settings: RegionSettings, path: Path) -> Partition | None:
    given = [name for name in ("grid", "tree", "function") if getattr(settings, name)]
    if len(given) > 1:
        table.wrong(given[1], f"and {given[0]} are both given; expected one of them")
    if settings.grid is not None or settings.tree is not None:
        return _by_position(top, table, settings)
    if settings.balance:
        table.wrong("balance", "moves the borders of regions by position: add grid or tree")
    if settings.reach != "everywhere":
        table.wrong("reach", "is about conditions on positions: add grid or tree")
    if settings.halo:
        table.wrong("halo", "is about positions near borders: add grid or tree")
    if not settings.count:
        if settings.function and "count" not in table:
            table.wrong("function", "needs the number of regions: add count")
        return None
    if not settings.function:
        return ById(settings.count)
    with table.loading("function"):
        function: Any = load(settings.function, path.parent)
    if not callable(function):
        table.wrong("function", f"names {settings.function}, which is not a function")
    return ByFunction(settings.count, function)


def _by_position(top: Table, table: Table, settings: RegionSettings) -> Partition:
    name, partition = (
        ("grid", _grid(table, cast("dict[str, Any]", settings.grid)))
        if settings.grid is not None
        else ("tree", ByTree(_split(table, settings.tree)))
    )
    cells = partition.count
    if cells > MAX_REGIONS:
        table.wrong(name, f"has {cells} cells; expected at most {MAX_REGIONS}")
    if settings.count not in (0, cells):
        what = f"the {name} has {cells} cells; omit it, or change the {name}"
        top.wrong_setting(RegionSettings, "count", f"is {settings.count}, but {what}")
    by_condition = settings.reach == "condition"
    balance, halo = settings.balance, settings.halo
    return replace(partition, balance=balance, by_condition=by_condition, halo=halo)


def _grid(table: Table, grid: dict[str, Any]) -> ByPosition:
    if not 1 <= len(grid) <= 2:
        table.wrong("grid", "must have one or two attributes, such as { x = [8, 16], y = [7] }")
    borders = [_borders(table, name, values) for name, values in grid.items()]
    names = [*grid, *grid][:2]
    return ByPosition(borders[0], *borders[1:], names=(names[0], names[1]))


def _split(table: Table, value: object) -> Split:
    """A split of a tree, read from its table."""
    split = cast("dict[str, object]", value) if isinstance(value, dict) else {}
    names = [name for name in split if name not in _PARTS]
    at = split[names[0]] if len(names) == 1 else None
    if type(at) not in (int, float) or not isfinite(cast("float", at)):
        expected = "must split at a number of one attribute, such as { x = 8 }"
        table.wrong("tree", f"{expected}, not {value!r:.60}")
    below, above = (_split(table, split[part]) if part in split else None for part in _PARTS)
    return Split(names[0], float(cast("float", at)), below, above)


def _borders(table: Table, name: str, values: object) -> tuple[float, ...]:
    numbers = cast("list[float]", values) if isinstance(values, list) else [float("nan")]
    if not all(type(each) in (int, float) and isfinite(each) for each in numbers):
        table.wrong("grid", f"must have a list of numbers for {name}, not {values!r:.40}")
    if any(low >= high for low, high in pairwise(numbers)):
        table.wrong("grid", f"must have ascending borders for {name}, not {values!r:.40}")
    return tuple(map(float, numbers))


def check_regions(file: WorldFile, members: Sequence[Member]) -> None:
    """Raise WorldFileError if the world contains what regions do not support."""
    world = file.world
    _check_attributes(file)
    halos = halo_services(file.partition, (each.service for each in members))
    _check_halos(file, halos)
    generators = [each for each in halos if isinstance(each, Generator)]
    generated = {name for each in generators for name in each.generates()}
    unsupported = {
        **{f"norms on events that name other agents ({name})": True for name in _naming(world)},
        # Each region has the events that concern its agents; other policies count all of them.
        f'policy = "{world.policy.value}"': world.policy is not Policy.SEQUENTIAL,
        "agents_per_host in [placement]": bool(world.placement.agents_per_host),
        # One coordinator counts the events of a service for all agents.
        "norms on events of services with halo = true": any(
            generated.intersection(norm.on) for norm in world.norms
        ),
    }
    outside = beside({each.name: each.service for each in members})
    commands = [each for each in file.processes if each.command and each.table not in file.hosts]
    apart = outside.union(each.name for each in commands)
    near = sorted(world.placement.neighbours & apart)
    unsupported[f"[placement] near a process outside of regions ({', '.join(near)})"] = bool(near)
    services = [
        f"{_unsupported_service(each.service)} ({each.name})"
        for each in members
        if each.name not in outside
    ]
    reasons = [what for what, is_used in unsupported.items() if is_used]
    reasons += _unsupported_processes(file.processes, apart)
    beside_regions = [each for each in members if each.name in outside]
    hosts = [each for each in file.processes if each.table in file.hosts]
    reasons += _unsupported_hosts(hosts, beside_regions)
    reasons += [reason for reason in services if not reason.startswith(" ")]
    _refuse(file, reasons)


def _check_attributes(file: WorldFile) -> None:
    """Raise WorldFileError if regions are divided by an attribute that no agent can have."""
    if not isinstance(file.partition, ByPosition | ByTree):
        return
    known = {name for kind in file.world.vocabulary.kinds.values() for name in kind.fields.names}
    for name in file.partition.attributes:
        if name not in known:
            hint = nearest(name, sorted(known), f"attributes: {', '.join(sorted(known))}")
            raise WorldFileError(
                f"{file.path}: [regions] divides by {name}, which no agent kind has{hint}"
            )


def _check_halos(file: WorldFile, services: Sequence[Service]) -> None:
    """Raise WorldFileError if services with a halo need other coordinates than regions have."""
    partition = file.partition
    by_view: dict[str, Halo] = {}
    devices = [each for each in services if isinstance(each, Device)]
    for drawn, halo in [(n, each.halo) for each in devices if each.halo for n in each.draws]:
        joined = by_view.setdefault(drawn, halo).joined(halo)
        if joined is None:
            raise WorldFileError(
                f"{file.path}: [regions] halo = true, but services look around agents in the same"
                f" view, {drawn}, by other coordinates or on other planes; give them views of their"
                " own, or remove halo"
            )
    halos = [service.halo for service in services if service.halo is not None]
    for halo in [each for each in halos if not each.everywhere]:
        assert isinstance(partition, ByPosition | ByTree)
        other = sorted({*partition.attributes} - {halo.x, halo.y})
        if other:
            raise WorldFileError(
                f"{file.path}: [regions] halo = true, but regions are divided by"
                f" {' and '.join(other)}, and a service looks around agents at {halo.x} and"
                f" {halo.y}; divide by these, or remove halo"
            )


def _naming(world: World) -> Iterator[str]:
    for norm in world.norms:
        if norm.on and norm.named:
            yield norm.name


def check_region_run(file: WorldFile, *, in_process: bool) -> None:
    """Raise WorldFileError if a run as regions cannot have its settings."""
    partition, unsupported = file.partition, dict[str, bool]()
    has_halos = isinstance(partition, ByPosition | ByTree) and partition.halo
    # The constructor of a service may take time, or have effects, so only if it is needed.
    if partition is None or not (has_halos or in_process):
        return
    services = {each.name: each.participant().service for each in file.processes}
    if has_halos and not halo_services(partition, services.values()):
        raise WorldFileError(
            f"{file.path}: [regions] halo = true, but no service in step looks around agents within"
            " a radius, as neighbours does; remove halo"
        )
    if in_process:
        commands = [each.name for each in file.processes if each.command or each.elsewhere]
        live = [name for name, service in services.items() if _is_in_real_time(service)]
        unsupported |= {
            f"views in real time ({', '.join(live)}) in one process": bool(live),
            f"commands ({', '.join(commands)}) in one process": bool(commands),
            "records (--record) in one process": bool(file.record.path),
            "tables of collected data ([collect], --collect) in one process": bool(
                file.collect.entries
            ),
            "metrics ([metrics], --metrics) in one process": bool(file.watch.metrics),
        }
    _refuse(file, [what for what, is_used in unsupported.items() if is_used])


def _refuse(file: WorldFile, reasons: Sequence[str]) -> None:
    if file.partition is not None and reasons:
        raise WorldFileError(f"{file.path}: regions do not support {reasons[0]}; {_INSTEAD}")


def _unsupported_processes(processes: Iterable[Process], outside: Collection[str]) -> Iterator[str]:
    inside = [each for each in processes if each.name not in outside]
    # If all of them are elsewhere, so are the regions.
    elsewhere = [each.name for each in inside if each.elsewhere]
    if len(elsewhere) not in (0, len(inside)):
        yield f"agents and services in step of which only some are elsewhere ({elsewhere[0]})"
    for process in processes:
        if process.speaks_for:
            yield f"generators that send in the name of agents ({process.name})"


def _unsupported_hosts(hosts: Iterable[Process], beside: Iterable[Member]) -> Iterator[str]:
    """What regions do not support of agents that have processes of their own in each region.

    `beside` are the members beside the regions.
    """
    shown = [each.name for each in beside if isinstance(each.service, Device)]
    for process in hosts:
        # Without its agents, the string would be another one.
        if process.on_failure == "ignore":
            yield f'hosts with on_failure = "ignore" ({process.name})'
        # The coordinator of the world makes these views, and has no code of the command.
        if process.command and shown:
            yield f"views ({shown[0]}) with hosts that are commands ({process.name})"


def _is_in_real_time(service: Service | None) -> bool:
    return isinstance(service, Device) and bool(
        service.rate or service.interactive or service.pulse_every
    )


def _unsupported_service(service: Service | None) -> str:
    """Why a service can run neither in each region with the same results nor in one; or ""."""
    if isinstance(service, Generator) and not service.lockstep:
        return "generators that run freely and exchange sensor topics with services in step"
    if _is_in_real_time(service):
        return "devices in real time that exchange sensor topics with services in step"
    if isinstance(service, Generator) and service.ahead and is_attached(service):
        return "generators that run ahead and have sensor topics or views"
    return ""
