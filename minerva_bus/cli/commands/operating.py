"""Commands that control a running world."""

from __future__ import annotations

from typing import Annotated, Final

import typer

from minerva_bus.cli import completing
from minerva_bus.cli.options import By, Json, NamedTarget, by_comma, examples, grouped
from minerva_bus.errors import MisuseError

TOPIC: Final = "Control"


@examples(
    "minerva pub eObjective marker=kitchen",
    "minerva pub robot eSpeed speed=30cm/s --to r1",
    "minerva pub eObjective marker=kitchen --as anna --wait",
)
@grouped
def pub(
    type: Annotated[
        str,
        typer.Argument(
            help="The event's type, such as eObjective.", autocompletion=completing.event_types
        ),
    ],
    data: Annotated[
        list[str] | None, typer.Argument(help="Data of the event: KEY=VALUE ...")
    ] = None,
    to: Annotated[
        list[str] | None, typer.Option(help="Ids of receiving agents, separated by commas.")
    ] = None,
    condition: Annotated[
        str, typer.Option("--if", help="Condition of the event, such as 'energy < 5'.")
    ] = "",
    by: By = "",
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait until it is rejected, accepted, done or failed.")
    ] = False,
    timeout: Annotated[
        float, typer.Option(help="Longest time of --wait in seconds; 0: no limit.", min=0)
    ] = 0.0,
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Send an event into a running world."""
    from minerva_bus.cli.operation import OrderToSend, publish

    if timeout and not wait:
        raise MisuseError("pub: --timeout limits --wait, which is missing")
    order = OrderToSend(type, tuple(data or ()), by_comma(to), condition, by)
    raise typer.Exit(publish(order, timeout if wait else None, target, json))


@examples("minerva stop", "minerva stop robot")
@grouped
def stop(by: By = "", json: Json = False, *, target: NamedTarget) -> None:
    """Stop a running world."""
    from minerva_bus.cli.operation import operate

    operate(lambda world: world.ask("stop", by=by), "asked to stop", target, json)


@examples("minerva pause", "minerva pause robot")
@grouped
def pause(by: By = "", json: Json = False, *, target: NamedTarget) -> None:
    """Pause a running world."""
    from minerva_bus.cli.operation import pause_after

    pause_after(lambda world: world.operator.named(by).pause(), target, json)


@examples("minerva resume", "minerva resume robot")
@grouped
def resume(by: By = "", json: Json = False, *, target: NamedTarget) -> None:
    """Resume a paused world."""
    from minerva_bus.cli.operation import operate

    operate(lambda world: world.operator.named(by).resume(), "resumed", target, json)


@examples("minerva step", "minerva step robot 10")
@grouped
def step(
    frames: Annotated[int, typer.Argument(help="Number of frames.", min=1)] = 1,
    by: By = "",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Run a number of frames, then pause."""
    from minerva_bus.cli.operation import pause_after

    pause_after(lambda world: world.operator.named(by).step(frames), target, json)


@examples("minerva rate 20", "minerva rate robot 0")
@grouped
def rate(
    hz: Annotated[float, typer.Argument(help="Frames per second; 0: as fast as possible.")],
    by: By = "",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Change the frame rate of a running world."""
    from minerva_bus.cli.operation import operate

    text = f"{hz:g} frames per second" if hz else "as fast as possible"
    operate(lambda world: world.operator.named(by).set_rate(hz), text, target, json, hz=hz)


@examples("minerva restart physics", "minerva restart robot hosts-2")
@grouped
def restart(
    member: Annotated[
        str, typer.Argument(help="A process of the world file.", autocompletion=completing.members)
    ],
    by: By = "",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Restart one process of a running world."""
    from minerva_bus.cli.operation import operate

    operate(
        lambda world: world.operator.named(by).restart(member),
        f"restarting {member}", target, json, member=member,
    )  # fmt: skip


@examples("minerva drain hosts-1", "minerva drain robot hosts-1")
@grouped
def drain(
    member: Annotated[
        str, typer.Argument(help="A host of agents.", autocompletion=completing.members)
    ],
    by: By = "",
    json: Json = False,
    *,
    target: NamedTarget,
) -> None:
    """Move all agents of a host to other hosts.

    The host can then be stopped without a pause of the world.
    """
    from minerva_bus.cli.operation import drain_member

    drain_member(member, by, target, json)
