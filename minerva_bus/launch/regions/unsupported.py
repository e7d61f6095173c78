"""What a world that runs as regions cannot contain."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.regions.attached import beside
from minerva_bus.regions.halo_services import halo_services
from minerva_bus.regions.partition import ByPosition
from minerva_bus.regions.tree import ByTree
from minerva_bus.world.halo import Halo
from minerva_bus.world.policy import Policy
from minerva_bus.world.services import Device, Generator, Service

_INSTEAD: Final = "run it with one coordinator (--regions 0); its string is the same"
_AS_PROCESSES: Final = "run its regions as processes (without --in-process)"


def check_regions(file: WorldFile, members: Sequence[Member]) -> None:
    """Raise WorldFileError if the world contains what regions do not support."""
    world = file.world
    _check_attributes(file)
    halos = halo_services(file.partition, (each.service for each in members))
    # Those who only need the code of agents have no services.
    made = {each.name for each in members}
    if made.issuperset(each.name for each in file.processes if each.make_service):
        _check_any_halo(file, halos)
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
    reasons = [what for what, is_used in unsupported.items() if is_used]
    reasons += _unsupported_processes(file.processes, apart)
    beside_regions = [each for each in members if each.name in outside]
    hosts = [each for each in file.processes if each.table in file.hosts]
    reasons += _unsupported_hosts(hosts, beside_regions)
    inside = [each for each in members if each.name not in outside]
    problems = {each.name: _unsupported_service(each.service) for each in inside}
    reasons += [f"{problem} ({name})" for name, problem in problems.items() if problem]
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


def _check_any_halo(file: WorldFile, halos: Collection[Service]) -> None:
    """Raise WorldFileError if no service could run in each region."""
    partition = file.partition
    if isinstance(partition, ByPosition | ByTree) and partition.halo and not halos:
        raise WorldFileError(
            f"{file.path}: [regions] halo = true, but no service in step looks around agents within"
            " a radius, as neighbours does; remove halo"
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


def check_in_process(file: WorldFile) -> None:
    """Raise WorldFileError if regions in this process cannot have a run's settings."""
    if file.partition is None:
        return
    # The constructor of a service may take time, or have effects, so only if it is needed.
    services = {each.name: each.participant().service for each in file.processes}
    commands = [each.name for each in file.processes if each.command or each.elsewhere]
    live = [name for name, service in services.items() if _is_in_real_time(service)]
    unsupported = {
        f"views in real time ({', '.join(live)})": bool(live),
        f"commands ({', '.join(commands)})": bool(commands),
        "records (--record)": bool(file.record.path),
        "tables of collected data ([collect], --collect)": bool(file.collect.entries),
        "metrics ([metrics], --metrics)": bool(file.watch.metrics),
    }
    reasons = [f"{what} in one process" for what, is_used in unsupported.items() if is_used]
    _refuse(file, reasons, _AS_PROCESSES)


def _refuse(file: WorldFile, reasons: Sequence[str], instead: str = _INSTEAD) -> None:
    if file.partition is not None and reasons:
        raise WorldFileError(f"{file.path}: regions do not support {reasons[0]}; {instead}")


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
    return ""
