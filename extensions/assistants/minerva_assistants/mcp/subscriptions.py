"""Subscriptions of clients to resources, and notifications of their changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import anyio
import anyio.to_thread
import mcp_types as types
from mcp.server.context import ServerRequestContext
from mcp.server.session import ServerSession
from mcp.server.subscriptions import InMemorySubscriptionBus, ListenHandler
from mcp.shared.exceptions import MCPError
from mcp.shared.subscriptions import ResourceUpdated

from minerva_assistants.mcp.connection import WorldConnection
from minerva_assistants.mcp.resources import Resource
from minerva_bus.errors import MinervaError

CHANGE_SECONDS: Final = 0.5
"""Time between checks for a new frame."""

MAX_STREAMS: Final = 64

Context = ServerRequestContext[Any]


class Subscriptions:
    """Clients that are notified when resources change, in both ways of the protocol.

    Args:
        link: the world.
        resources: the resources that clients may subscribe to.

    """

    def __init__(self, link: WorldConnection, resources: Sequence[Resource]) -> None:
        self._link = link
        self._resources = resources
        self._bus = InMemorySubscriptionBus()
        self._subscribed: dict[str, list[ServerSession]] = {}
        self.listen = ListenHandler(self._bus, max_subscriptions=MAX_STREAMS)

    async def add(
        self, context: Context, params: types.SubscribeRequestParams
    ) -> types.EmptyResult:
        """Subscribe a client. Raises MCPError if there is no such resource."""
        uri = str(params.uri)
        if uri not in [each.uri for each in self._resources]:
            message = f"there is no resource {uri[:200]!r}"
            raise MCPError(types.INVALID_PARAMS, message, {"uri": uri})
        sessions = self._subscribed.setdefault(uri, [])
        if context.session not in sessions:
            sessions.append(context.session)
        return types.EmptyResult()

    async def remove(
        self, context: Context, params: types.UnsubscribeRequestParams
    ) -> types.EmptyResult:
        """Unsubscribe a client."""
        sessions = self._subscribed.get(str(params.uri), [])
        if context.session in sessions:
            sessions.remove(context.session)
        return types.EmptyResult()

    async def report_changes(self) -> None:
        """Notify subscribers when another frame has begun, at most twice a second."""
        last = -1
        while True:
            await anyio.sleep(CHANGE_SECONDS)
            frame = await anyio.to_thread.run_sync(self._frame, abandon_on_cancel=True)
            if frame == last:
                continue
            last = frame
            for resource in self._resources:
                if resource.changes:
                    await self._report(resource.uri)

    def _frame(self) -> int:
        try:
            return self._link.live().frame
        except MinervaError:
            return -1

    async def _report(self, uri: str) -> None:
        await self._bus.publish(ResourceUpdated(uri=uri))
        for session in list(self._subscribed.get(uri, ())):
            try:
                await session.send_resource_updated(uri)
            except (MCPError, anyio.ClosedResourceError, anyio.BrokenResourceError):
                self._subscribed[uri].remove(session)  # The client has left.
