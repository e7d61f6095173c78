"""`minerva attach`."""

from __future__ import annotations

import signal
import sys
from contextlib import nullcontext, redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Final

from minerva_bus.cli.options import JoinOptions
from minerva_bus.cli.output import FAILED, Done, print_message, print_report
from minerva_bus.cli.places import identity, place
from minerva_bus.errors import KeysError, MisuseError, UnknownOption, WorldFileError, nearest
from minerva_bus.frame.member_side import Member, WorldRestarted
from minerva_bus.launch.child_processes import end_signals
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.process_specs import ProcessSpec, compile_agents
from minerva_bus.launch.specs import Factory, described, find_agent, find_service, names_agents
from minerva_bus.launch.toml_tables import typed_options
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.endpoints import check_endpoint, check_reachable
from minerva_bus.runtime.joining import ARRIVAL
from minerva_bus.runtime.participants import BACK_WITHIN, MemberProcess
from minerva_bus.runtime.session import CONNECT_SECONDS, end_at_once
from minerva_bus.settings.world_settings import Overrides
from minerva_bus.user_code import report
from minerva_bus.world.services import Device

RECONNECT_SECONDS: Final = 600.0
"""Time to try to reconnect to a remote world. A local world that is restarted listens at another
endpoint, so for it BACK_WITHIN is enough.
"""


def attach_member(
    spec: str,
    join: JoinOptions,
    options: dict[str, str],
    process: str = "",
    *,
    standby: bool = False,
) -> int:
    """Run a member until the world, its source or the user ends it; returns the exit code.

    `process`: the process of the world file `spec` that it is. A `standby` takes the place of the
    running one when that has gone. Without a name in `join`, the member has the name in its
    certificate.
    """
    # A remote world takes the name from the certificate, so a generated one would be rejected.
    if standby and not process:
        raise MisuseError("--standby is for processes of the world file: add --process NAME")
    shown = identity() if join.connect and not join.name and not process else None
    name = join.name if shown is None else shown.name
    while True:
        # A new participant for each attempt, so that its service begins in its initial state.
        preferred = ""
        if process:
            preferred, participant = _of_file(spec, process, name, options)
        else:
            participant = _participant(spec, name, options)
        try:
            return _attached(participant, join, preferred, standby=standby)
        except WorldRestarted as restarted:
            print_message(f"{participant.name}: {restarted}; joining again")


def _attached(participant: Member, join: JoinOptions, preferred: str, *, standby: bool) -> int:
    """Join a world and run the member in it to its end; returns the exit code."""
    own = identity(participant.name) if join.connect else None
    if own is not None and own.name != participant.name:
        raise KeysError(f"the certificate is of {own.name}: attach with --name {own.name}")
    endpoint, world = place(join, own, preferred)
    there = check_endpoint(endpoint)
    if not there.local:  # Before Ctrl-C is handled as leaving, because this can take long.
        check_reachable(there, CONNECT_SECONDS)

    within = join.keep_trying
    if within is None:
        within = BACK_WITHIN if there.local else RECONNECT_SECONDS
    arrival = replace(ARRIVAL, standby=standby, claims=True)
    member = MemberProcess(
        [participant],
        world,
        endpoint,
        print_message,
        own=own,
        ends=not isinstance(participant.service, Device),
        back_within=within,
        arrival=arrival,
    )
    leave_on_signals(member)
    print_message(f"{participant.name}: joining {world} at {endpoint}; Ctrl-C leaves")
    code = _run(member, participant, as_json=join.json)
    failure = "" if member.failure is None else report(member.failure)
    print_report(_end(participant, world, endpoint, failure), join.json)
    end_at_once(code)
    return code


def _run(member: MemberProcess, participant: Member, *, as_json: bool) -> int:
    """Take part until the end; returns the exit code, which is at most FAILED.

    Other codes, such as RAISED, are for a launcher that may restart the member.
    """
    # A service may print, but only the answer may be on standard output.
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        return min(member.run(), FAILED) or int(getattr(participant.service, "failed", False))


def _end(member: Member, world: str, endpoint: str, failure: str) -> Done:
    """The end of a membership; without text if the member left at the request of its user."""
    lines = [f"{member.name}: failed: {failure}"] if failure else []
    if member.stopped:
        lines.append(f"{member.name}: the world has ended: {member.stopped}")
    fields = {"member": member.name, "world": world, "endpoint": endpoint}
    return Done("\n".join(lines), {**fields, "ended": member.stopped, "failure": failure})


def leave_on_signals(member: MemberProcess) -> None:
    """Leave the world on a signal that ends a process; a second signal terminates at once."""

    def leave(number: int, frame: FrameType | None) -> None:
        # The service may be busy and delay the end; the next signal does not wait for it.
        signal.signal(number, signal.SIG_DFL)
        member.leave()

    for number in end_signals():
        signal.signal(number, leave)


def _participant(spec: str, name: str, options: dict[str, str]) -> Member:
    import os

    folder = Path.cwd()
    short = spec.rpartition(":")[2].rpartition(".")[2].lower()
    name = name or f"{short}-{os.getpid()}"
    if names_agents(spec, folder):
        if options:
            raise WorldFileError(f"{spec} names agents, which have no options")
        agent = find_agent(spec, folder)
        compile_agents([ProcessSpec(name, agents=(agent,))])
        return Member(name, None, [agent])
    service = find_service(spec, folder)
    known = [flag.split()[0] for flag, _ in described(spec)] if ":" not in spec else []
    for key in options:
        # An option of the command itself may be meant, so its suggestions count, too.
        if known and f"--{key.partition('.')[0]}" not in known:
            raise UnknownOption(spec, f"--{key}", known)
    return Member(name, Factory(service, typed_options(service, options), name)())


def _of_file(spec: str, process: str, name: str, options: dict[str, str]) -> tuple[str, Member]:
    """Name of a world file, and its process that is named. Raises WorldFileError if none has."""
    file = read_world_file(find_world(spec), Overrides(options=options))
    known = {each.name: each for each in file.processes}
    if process not in known:
        hint = nearest(process, list(known), f"there are {', '.join(known)}")
        raise WorldFileError(f"{file.path}: there is no process {process!r}{hint}")
    if known[process].command:
        raise WorldFileError(f"{process} is a command: run it itself, with MINERVA_CONNECT set")
    # Before it joins, because the world waits for its members in each frame.
    compile_agents([replace(known[process], elsewhere=False)])
    return file.world.name, replace(known[process], name=name or process).make_member()
