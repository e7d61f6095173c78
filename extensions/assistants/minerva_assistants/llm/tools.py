"""Tools of MCP servers that a model may call before it answers.

    tools.files = { command = ["python", "files.py"], allow = ["read"] }
    tools.maps = { url = "http://localhost:8000/mcp", allow = ["route"] }

A model calls a tool by the answer `{"tool": "files.read", "arguments": {...}}`, so every backend
can use them. Each call has a connection of its own: a server that hangs or dies during a call
disturbs no other one. What a server sends is text for the model, of limited length, and nothing
else.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, nearest

KEYS: Final = ("command", "url", "allow", "timeout")
CALL: Final = {"tool", "arguments"}
MAX_RESULT: Final = 4000
"""Characters of a result that a model receives, and that the record has."""

MAX_DESCRIPTION: Final = 1000
LISTED_AGAIN_SECONDS: Final = 30.0
"""Time after which a server that has failed to list its tools is asked again."""

USE: Final = (
    'You may use tools before you answer. To call one, answer only with {{"tool": NAME,'
    ' "arguments": {{...}}}}; you receive its result, and are asked again. The tools:\n{}'
)


@dataclass(frozen=True, slots=True)
class UsedTool:
    """A call of a tool with its result; `seconds` is measured by the clock."""

    tool: str
    arguments: Mapping[str, Any]
    result: str
    failed: bool
    seconds: float

    @property
    def shown(self) -> str:
        """The result as the model receives it."""
        outcome = "has failed" if self.failed else "returned"
        return f"The tool {self.tool} {outcome}: {self.result}"


@dataclass(frozen=True, slots=True)
class ToolServer:
    """An MCP server: a program with its arguments, or a URL; and the tools that may be called."""

    name: str
    command: tuple[str, ...]
    url: str
    allow: tuple[str, ...]
    timeout: float

    @staticmethod
    def of(name: str, table: Any) -> ToolServer:
        """A server from an option. Raises MisuseError."""
        about = f"llm: tools.{name}"
        if not isinstance(table, Mapping):
            raise MisuseError(f"{about} is {table!r:.60}; expected a table")
        given = cast("Mapping[str, Any]", table)
        for key in given:
            if key not in KEYS:
                raise MisuseError(f"{about} has no {key!r}{nearest(key, list(KEYS))}")
        if ("command" in given) == ("url" in given):
            raise MisuseError(f"{about} needs either a command or a url")
        url, timeout = given.get("url", ""), given.get("timeout", 10.0)
        command, allow = _texts(about, given, "command"), _texts(about, given, "allow")
        if not isinstance(url, str) or (url and not url.startswith(("http://", "https://"))):
            raise MisuseError(f"{about}.url is {url!r:.60}; expected http://... or https://...")
        if not allow or not (url or command):
            missing = "allow" if (url or command) else "command"
            raise MisuseError(f"{about}.{missing} is empty; expected a list of texts")
        if isinstance(timeout, bool) or not isinstance(timeout, int | float) or not timeout > 0:
            raise MisuseError(f"{about}.timeout is {timeout!r:.60}; expected seconds above 0")
        return ToolServer(name, command, url, allow, float(timeout))

    async def listed(self) -> list[dict[str, Any]]:
        """The permitted tools as JSON objects.

        Raises OSError, TimeoutError and errors of the SDK.
        """
        async with asyncio.timeout(self.timeout), self._client() as client:
            tools = (await client.list_tools()).tools
        return [
            {
                "name": f"{self.name}.{tool.name}",
                "description": (tool.description or "")[:MAX_DESCRIPTION],
                "arguments": _short_schema(tool.input_schema),
            }
            for tool in tools
            if tool.name in self.allow
        ]

    async def call(self, tool: str, arguments: dict[str, Any]) -> tuple[str, bool]:
        """The text of a result, and whether it is a failure. Raises what `listed` raises."""
        async with asyncio.timeout(self.timeout), self._client() as client:
            result = await client.call_tool(tool, arguments)
        texts = [getattr(content, "text", f"({content.type})") for content in result.content]
        return "\n".join(texts)[:MAX_RESULT], bool(result.is_error)

    def _client(self) -> Any:
        # Imported late: only tools need the extra.
        from mcp import Client, StdioServerParameters

        if self.url:
            return Client(self.url)
        return Client(StdioServerParameters(command=self.command[0], args=[*self.command[1:]]))


class ToolServers:
    """The servers of a service, for all requests; `used` counts calls.

    Args:
        servers: the servers.
        concurrent: calls at the same time.
        log: receives problems.

    """

    def __init__(
        self, servers: Sequence[ToolServer], concurrent: int, log: Callable[[str], None]
    ) -> None:
        self.used: int = 0
        self._servers = {server.name: server for server in servers}
        self._places = asyncio.Semaphore(concurrent)
        self._log = log
        self._listed: dict[str, tuple[float, list[dict[str, Any]]]] = {}

    @staticmethod
    def of(
        option: Mapping[str, Any] | None, concurrent: int, log: Callable[[str], None]
    ) -> ToolServers:
        """The servers of an option. Raises MisuseError."""
        servers = [ToolServer.of(name, table) for name, table in (option or {}).items()]
        return ToolServers(servers, concurrent, log)

    def __bool__(self) -> bool:
        return bool(self._servers)

    async def text(self) -> str:
        """What a model must know to use the tools; empty if there are none."""
        await asyncio.gather(*[self._list(server) for server in self._servers.values()])
        tools = [tool for name in self._servers for tool in self._listed[name][1]]
        return USE.format("\n".join([json.dumps(tool) for tool in tools])) if tools else ""

    def wanted(self, answer: Mapping[str, Any] | None) -> bool:
        """Whether an answer calls a tool."""
        return bool(self) and answer is not None and answer.keys() == CALL

    async def call(self, wanted: Mapping[str, Any]) -> UsedTool:
        """Call a tool; a failure is a result."""
        tool, arguments, began = wanted["tool"], wanted["arguments"], time.monotonic()
        server_name, _, name = str(tool).partition(".")
        server = self._servers.get(server_name)
        if server is None or name not in server.allow:
            return UsedTool(str(tool)[:100], {}, "there is no such tool", True, 0.0)
        if not isinstance(arguments, dict):
            return UsedTool(str(tool), {}, "`arguments` is not a JSON object", True, 0.0)
        given = cast("dict[str, Any]", arguments)
        self.used += 1
        async with self._places:
            try:
                result, failed = await server.call(name, given)
            except Exception as error:
                result, failed = self._failure(server, error), True
        return UsedTool(str(tool), given, result, failed, round(time.monotonic() - began, 3))

    async def _list(self, server: ToolServer) -> None:
        """List the tools of a server; one that fails has none for a while."""
        at, tools = self._listed.get(server.name, (0.0, []))
        if tools or (at and time.monotonic() < at + LISTED_AGAIN_SECONDS):
            return
        try:
            async with self._places:
                tools = await server.listed()
        except Exception as error:
            self._failure(server, error)
        self._listed[server.name] = time.monotonic(), tools

    def _failure(self, server: ToolServer, error: Exception) -> str:
        """The reason of a failure in one line, which is logged, too."""
        while isinstance(error, ExceptionGroup):
            error = error.exceptions[0]
        late = f"no result within {server.timeout:g} s"
        reason = late if isinstance(error, TimeoutError) else f"{type(error).__name__}: {error}"
        shown = " ".join(reason.split())[:200]
        self._log(f"llm: tools.{server.name}: {shown}")
        return shown


def _short_schema(schema: dict[str, Any]) -> dict[str, Any]:
    return schema if len(json.dumps(schema)) <= MAX_RESULT else {"type": "object"}


def _texts(about: str, table: Mapping[str, Any], key: str) -> tuple[str, ...]:
    value = table.get(key, [])
    if not isinstance(value, list | tuple):
        raise MisuseError(f"{about}.{key} is {value!r:.60}; expected a list of texts")
    items = cast("Sequence[Any]", value)
    if not all(isinstance(item, str) for item in items):
        raise MisuseError(f"{about}.{key} is {value!r:.60}; expected a list of texts")
    return tuple(items)
