"""One call of a tool: its limits, its checks and its result."""

from __future__ import annotations

import base64
import json
import logging
from collections.abc import Iterable, Mapping
from typing import Any, Final, cast

import mcp_types as types

from minerva_assistants.mcp.tool import Result, Tool, ToolCall, ToolImage, shortened
from minerva_bus.errors import MinervaError, nearest

MAX_BYTES: Final = 65_536
"""Size of the arguments of one call, as JSON."""

MAX_NAME: Final = 60


def run_call(
    name: str, call: ToolCall, tools: Iterable[Tool], allow: frozenset[str]
) -> types.CallToolResult:
    """Check a call and run it; what is wrong with it becomes its result.

    Args:
        name: the tool that the client names.
        call: the call.
        tools: all tools of the server, also those that need a permission.
        allow: the permissions of the server.

    """
    problem = _oversized(call.arguments)
    if problem:
        return failure(problem)
    by_name = {tool.name: tool for tool in tools}
    tool = by_name.get(name)
    if tool is None:
        hint = nearest(name[:MAX_NAME], [*by_name])
        return failure(f"there is no tool {name[:MAX_NAME]!r}{hint}; see tools/list")
    if not tool.allowed(allow):
        return failure(
            f"{name} is not permitted: the server was started without --allow {tool.permission}"
        )
    problem = _invalid_arguments(tool, call.arguments)
    if problem:
        return failure(problem)
    try:
        return _success(tool.run(call))
    except MinervaError as error:
        return failure(str(error))
    except Exception as error:
        # One failed call must not end the server; the log has the traceback.
        logging.getLogger(__name__).exception("the tool %s failed", tool.name)
        return failure(f"{tool.name} failed: {type(error).__name__}: {error}")


def _oversized(arguments: Mapping[str, Any]) -> str:
    try:
        size = len(json.dumps(arguments))
    except (RecursionError, ValueError, TypeError):
        return "the arguments are nested too deeply, or are no JSON"
    return f"the arguments have {size} bytes; at most {MAX_BYTES}" if size > MAX_BYTES else ""


def _invalid_arguments(tool: Tool, arguments: Mapping[str, Any]) -> str:
    """What is wrong with arguments; empty if they fit the schema of the tool."""
    # Imported late: beside JupyterLab, jsonschema compiles a grammar of IRIs for 2 s.
    import jsonschema

    validator: Any = jsonschema.Draft202012Validator(tool.schema)
    try:
        errors = sorted(
            validator.iter_errors(dict(arguments)), key=lambda error: list(map(str, error.path))
        )
    except RecursionError:
        return f"{tool.name}: the arguments are nested too deeply"
    if not errors:
        return ""
    place = ".".join(str(part) for part in errors[0].path)
    message = f"{_message(errors[0])[:400]}{_remedy(errors[0], tool)}"
    return f"{tool.name}: {place}: {message}" if place else f"{tool.name}: {message}"


def _message(error: Any) -> str:
    """What is wrong with a value, without the middle of a long one, which would hide the reason."""
    return str(error.message).replace(repr(error.instance), shortened(repr(error.instance)))


def _remedy(error: Any, tool: Tool) -> str:
    if error.validator == "maxLength":
        return f"; at most {error.validator_value} characters"
    known = [*tool.properties]
    if error.validator == "required" and not error.path:
        return f"; it takes {', '.join(known)}"
    unknown = error.validator == "additionalProperties" and not error.path
    names = [name for name in error.instance if name not in known] if unknown else []
    listed = f"it takes {', '.join(known) or 'none'}"
    return nearest(names[0][:MAX_NAME], known, listed) if names else ""


def _success(result: Result) -> types.CallToolResult:
    if isinstance(result, ToolImage):
        data = base64.b64encode(result.content).decode("ascii")
        image = types.ImageContent(data=data, mime_type=result.media_type)
        return types.CallToolResult(content=[image])
    shown = json.dumps(result, ensure_ascii=False, allow_nan=False, default=str)
    return types.CallToolResult(
        content=[types.TextContent(text=shown)],
        structured_content=cast("dict[str, Any]", json.loads(shown)),
    )


def failure(message: str) -> types.CallToolResult:
    """The result of a call that was rejected, or has failed."""
    return types.CallToolResult(content=[types.TextContent(text=message[:4000])], is_error=True)
