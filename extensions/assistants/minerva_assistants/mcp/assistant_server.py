"""`minerva mcp`: a Model Context Protocol server for a world."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack, closing
from pathlib import Path

from minerva_assistants.mcp.permissions import checked_permissions
from minerva_bus.api.live import Live
from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.output import Done, print_message, print_report
from minerva_bus.cli.places import client
from minerva_bus.errors import BusError, MinervaError
from minerva_bus.launch.registry import find
from minerva_bus.settings.kinds import address
from minerva_bus.wording import install
from minerva_services.web_access import new_token


def serve_assistants(
    target: WorldTarget, allow: Iterable[str], listen: str, folder: Path, code: str, as_json: bool
) -> None:
    """Serve at standard input and output, or at an address, until the client leaves or Ctrl-C."""
    try:
        from minerva_assistants.mcp.server import WorldServer
        from minerva_assistants.mcp.serving import check_listen, serve_http, serve_stdio, short_log
    except ImportError:
        raise MinervaError(f"mcp needs the MCP SDK: {install('mcp')}") from None
    from minerva_assistants.mcp.connection import WorldConnection

    if not folder.is_dir():
        raise MinervaError(f"--folder: there is no folder {folder}")
    if not target.connect:
        try:
            find(target.world)
        except BusError as error:
            # No error, because an assistant's configuration starts the server at any time.
            print_message(f"warning: {error}; the tools look for it at each call")
    link = WorldConnection(lambda: _connected(target, code))
    world = WorldServer(link, checked_permissions(allow), folder, print_message)
    with closing(link), short_log():
        if not listen:
            serve_stdio(world)
            return
        host, port = address(listen)
        check_listen(host)

        def listening(url: str) -> None:
            allowed = sorted(allow)
            text = f"MCP at {url} ({', '.join(allowed) or 'read-only'})"
            print_report(Done(text, {"url": url, "allow": allowed}), as_json)

        serve_http(world, host, port, new_token() if allow else "", listening)


def _connected(target: WorldTarget, code: str) -> Live:
    from minerva_bus.api.on_bus import OnBus
    from minerva_bus.api.world import World
    from minerva_bus.launch.installed import installed_worlds

    with ExitStack() as stack:
        connected = stack.enter_context(client(target))
        # Pictures need the classes of agents, which a world does not send.
        source = code or (connected.world if connected.world in installed_worlds() else "")
        agents = World.load(source).agents if source else []
        return Live(OnBus(connected, stack), agents)
