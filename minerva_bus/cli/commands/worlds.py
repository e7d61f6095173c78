"""`minerva list` to `metrics`: what is asked of a world that runs, and what it is told."""

from __future__ import annotations

from typing import Annotated

import typer

from minerva_bus.cli.options import Connect, Json, Keys, World, chosen

app = typer.Typer()

Named = Annotated[str, typer.Argument(metavar="[WORLD]", help="As --world.")]


@app.command("list")
def list_(
    name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "", json: Json = False
) -> None:
    """Show who takes part in a running world; several worlds: show the worlds."""
    from minerva_bus.cli.asking import list_members

    list_members(connect, chosen(name, world), json)


@app.command()
def echo(
    type: Annotated[str, typer.Argument(help="An event type, an agent kind; nothing: all.")] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    count: Annotated[int, typer.Option(help="End after so many; 0: never.")] = 0,
    json: Json = False,
) -> None:
    """Watch a world's events, its agents' fragments, or a view, by type."""
    from minerva_bus.cli.asking import echo_type

    echo_type(type, connect, world, count, json)


@app.command()
def pub(
    type: Annotated[str, typer.Argument(help="The event's type, such as eObjective.")],
    data: Annotated[list[str] | None, typer.Argument(help="Its data: KEY=VALUE ...")] = None,
    to: Annotated[list[str] | None, typer.Option(help="An agent's id; may be repeated.")] = None,
    condition: Annotated[str, typer.Option("--if", help="Such as 'energy < 5'.")] = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Send an event into a running world."""
    from minerva_bus.cli.asking import publish

    publish(type, data or [], to or [], condition, connect, world, json)


@app.command()
def stop(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """End a running world."""
    from minerva_bus.cli.asking import stop_world

    stop_world(connect, chosen(name, world))


@app.command()
def pause(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """Let a running world rest between two frames."""
    from minerva_bus.cli.operating import pause_world

    pause_world(connect, chosen(name, world))


@app.command()
def resume(name: Named = "", connect: Connect = "", keys: Keys = "", world: World = "") -> None:
    """Let a paused world go on."""
    from minerva_bus.cli.operating import resume_world

    resume_world(connect, chosen(name, world))


@app.command()
def step(
    frames: Annotated[int, typer.Argument(help="How many frames.", min=1)] = 1,
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Run some frames of a world, and pause it."""
    from minerva_bus.cli.operating import step_world

    step_world(frames, connect, world)


@app.command()
def rate(
    hz: Annotated[float, typer.Argument(help="Frames per second; 0: as fast as it goes.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Change how fast a running world goes."""
    from minerva_bus.cli.operating import set_rate

    set_rate(hz, connect, world)


@app.command()
def restart(
    member: Annotated[str, typer.Argument(help="A process of the world file.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Start one process of a running world anew."""
    from minerva_bus.cli.operating import restart_member

    restart_member(member, connect, world)


@app.command()
def drain(
    member: Annotated[str, typer.Argument(help="A host of agents.")],
    world: World = "",
    connect: Connect = "",
    keys: Keys = "",
) -> None:
    """Empty a host of agents, so that it can be stopped: others take over at a frame's edge."""
    from minerva_bus.cli.operating import drain_member

    drain_member(member, connect, world)


@app.command()
def logs(
    member: Annotated[str, typer.Argument(help="Only of this member.")] = "",
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with what comes.")] = False,
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Json = False,
) -> None:
    """Show what the members of a running world have printed, and what was said of them."""
    from minerva_bus.cli.operating import show_logs

    show_logs(member, follow, connect, world, json)


@app.command()
def top(
    name: Named = "",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
    json: Annotated[bool, typer.Option("--json", help="Print one status as JSON.")] = False,
) -> None:
    """Watch a running world in the terminal; pause it, step, restart a member."""
    from minerva_bus.cli.topping import watch_world

    watch_world(connect, chosen(name, world), json)


@app.command()
def metrics(
    name: Named = "",
    listen: Annotated[str, typer.Option(help="Serve at HOST:PORT.")] = "127.0.0.1:9464",
    connect: Connect = "",
    keys: Keys = "",
    world: World = "",
) -> None:
    """Serve a running world's /metrics, /live and /ready, from a process of its own."""
    from minerva_bus.cli.measuring import serve_metrics

    serve_metrics(listen, connect, chosen(name, world))
