"""MCP: the conformance tests of the protocol against our server, with the tools that they name.

python -m tools.acceptance.assistants       # the server; prints its address
"""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from minerva_bus.errors import MisuseError
from tools.acceptance.suite import MissingSuiteError, Result, Suite, judged

PACKAGE = "@modelcontextprotocol/conformance"
SECONDS = 300.0

PROMPTS = "the server has no prompts"
QUESTIONS = "no tool of the server asks the client (sampling, elicitation)"
REASONS = {
    "logging-set-level": "the server does not offer to log to clients",
    "tools-call-with-logging": "the server does not offer to log to clients",
    "completion-complete": "the server does not complete arguments",
    "tools-call-audio": "no tool of the server results in a sound",
    "tools-call-embedded-resource": "no tool of the server results in a resource",
    "tools-call-mixed-content": "no tool of the server results in several contents",
    "resources-read-binary": "all resources of the server are texts",
    "resources-templates-read": "the only template of the server is that of agents",
}
"""Why a scenario does not apply, by its name."""

_SCENARIO = re.compile(r"^[✓✗] (\S+): \d+ passed, (\d+) failed$", re.M)
_OTHERS = (("prompts-", PROMPTS), ("sampling", QUESTIONS), ("elicitation", QUESTIONS))


def _expected(scenario: str) -> str:
    return REASONS.get(scenario) or next((why for part, why in _OTHERS if part in scenario), "")


def _picture() -> bytes:
    """A red pixel as PNG."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0))
    data = chunk(b"IDAT", zlib.compress(b"\0\xff\0\0"))
    return b"\x89PNG\r\n\x1a\n" + header + data + chunk(b"IEND", b"")


def main() -> None:
    """Serve the tools and resources that the tests name; no world runs."""
    from minerva_assistants.mcp.connection import WorldConnection
    from minerva_assistants.mcp.resources import Resource
    from minerva_assistants.mcp.server import WorldServer
    from minerva_assistants.mcp.serving import serve_http
    from minerva_assistants.mcp.tool import Tool, ToolCall, ToolImage

    def fail(call: ToolCall) -> Any:
        raise MisuseError("this tool fails")

    def last(call: ToolCall) -> Any:
        call.stop.wait(3.5)  # The server reports its progress each second.
        return {"done": True}

    def no_world() -> Any:
        raise MisuseError("no world runs")

    class SchemaTool(Tool):
        @property
        def schema(self) -> dict[str, Any]:
            address = {"type": "object", "properties": {"street": {"type": "string"}}}
            return {
                "$schema": "https://json-schema.org/draft/2020-12/schema",
                "$defs": {"address": address},
                "type": "object",
                "properties": {"name": {"type": "string"}, "address": {"$ref": "#/$defs/address"}},
                "additionalProperties": False,
            }

    server = WorldServer(
        WorldConnection(no_world),
        tools=[
            Tool("test_simple_text", "A text.", lambda call: {"text": "a simple text"}),
            Tool("test_image_content", "A picture.", lambda _: ToolImage(_picture(), "image/png")),
            Tool("test_error_handling", "An error.", fail),
            Tool("test_tool_with_progress", "A call of 3.5 s.", last),
            Tool("test_reconnection", "An answer.", lambda call: {"done": True}),
            SchemaTool("json_schema_2020_12_tool", "A schema.", lambda call: {}),
        ],
        resources=[
            Resource("static-text", "A text.", lambda call: "A text.", "text/plain", root="test:/"),
            Resource("watched-resource", "A text.", lambda call: "A text.", root="test:/"),
        ],
    )
    serve_http(server, "127.0.0.1", 0, "", lambda url: print(url, flush=True))


@contextmanager
def _server() -> Iterator[str]:
    """The server in a process; its address."""
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        cwd=Path(__file__).resolve().parents[2],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()


def _failures(folder: Path, scenario: str) -> Iterator[str]:
    """Messages of the failed checks of a scenario."""
    for path in folder.glob(f"server-{scenario}-2*/checks.json"):
        for check in json.loads(path.read_text(encoding="utf-8")):
            if check["status"] == "FAILURE":
                yield f"{check['id']}: {check.get('errorMessage') or check.get('details')}"


def _results(folder: Path) -> Iterator[Result]:
    program, own = (
        folder / "node_modules" / ".bin" / "conformance",
        folder / "node_modules/.bin/node",
    )
    node = str(own) if own.exists() else shutil.which("node")
    if not program.exists() or node is None:
        raise MissingSuiteError(f"run npm install {PACKAGE} node@22 in {folder}")
    if not find_spec("mcp"):
        raise MissingSuiteError("it needs the SDK of MCP: pip install 'minerva-bus[mcp]'")
    command = [node, str(program), "server", "--suite", "all"]
    with TemporaryDirectory(prefix="minerva-acceptance-") as place, _server() as address:
        done = subprocess.run(
            [*command, "--url", address, "-o", place],
            cwd=place, capture_output=True, text=True, timeout=SECONDS, check=False,
        )  # fmt: skip
        for scenario, failed in _SCENARIO.findall(done.stdout):
            problems = [*_failures(Path(place), scenario), "failed"] if int(failed) else []
            yield judged(scenario, problems, _expected(scenario))


CONFORMANCE = Suite(
    "mcp",
    "modelcontextprotocol/conformance",
    ".",
    "the server of `minerva mcp`: scenarios of the protocol that apply",
    _results,
)

if __name__ == "__main__":
    main()
