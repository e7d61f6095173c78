"""The server of `minerva mcp` with the tools, resources and prompts that MCP's conformance suite calls.

What `minerva mcp` offers as well (text, images, errors, progress, schemas, resources,
subscriptions) is declared as its own tools and resources are, and takes the same way. Of what it
does not offer (audio, embedded and binary resources, prompts, completion, logging, sampling,
elicitation), handlers are added to its server, so that transport and sessions are tested with it.

    python -m tests.assistants.reference_server WORLD

"""

import base64
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import mcp_types as types

from minerva_assistants.mcp.connection import WorldConnection
from minerva_assistants.mcp.resources import RESOURCES, Resource
from minerva_assistants.mcp.server import WorldServer
from minerva_assistants.mcp.serving import serve_http
from minerva_assistants.mcp.tool import Tool, ToolImage
from minerva_bus.api.live import Live
from minerva_bus.api.on_bus import OnBus
from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.places import client
from minerva_bus.errors import MisuseError

PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8DwHwAFBQIAX8jx0gAAAABJRU5ErkJggg=="
WAV = "UklGRiYAAABXQVZFZm10IBAAAAABAAEAQB8AAAB9AAACABAAZGF0YQIAAAA="
PROGRESS_SECONDS = 3.5
"""Longer than three reports of progress."""


# --- what `minerva mcp` offers as well ---


def _error(call):
    raise MisuseError("This tool intentionally returns an error for testing")


def _slow(call):
    call.stop.wait(PROGRESS_SECONDS)
    return {"text": "done"}


@dataclass(frozen=True, slots=True)
class SchemaTool(Tool):
    """A tool with the schema that the suite expects."""

    @property
    def schema(self) -> dict[str, Any]:
        address = {"street": {"type": "string"}, "city": {"type": "string"}}
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "type": "object",
            "$defs": {"address": {"type": "object", "properties": address}},
            "properties": {"name": {"type": "string"}, "address": {"$ref": "#/$defs/address"}},
            "additionalProperties": False,
        }


TOOLS = (
    Tool("test_simple_text", "Return text.", lambda call: {"text": "This is a simple text."}),
    Tool(
        "test_image_content",
        "Return an image.",
        lambda call: ToolImage(base64.b64decode(PNG), "image/png"),
    ),
    Tool("test_error_handling", "Fail.", _error),
    Tool("test_tool_with_progress", "Take some seconds.", _slow),
    SchemaTool("json_schema_2020_12_tool", "Have a schema.", lambda call: {"text": "done"}),
)
STATIC = (
    Resource("static-text", "A text.", lambda call: "A static text.", "text/plain", root="test:/"),
    Resource("watched-resource", "A text.", lambda call: "changes", "text/plain", root="test:/"),
)


# --- what it does not offer ---


def _text(text):
    return types.TextContent(text=text)


def _embedded(uri="test://embedded-resource"):
    return types.EmbeddedResource(
        resource=types.TextResourceContents(uri=uri, mime_type="text/plain", text="embedded")
    )


def _image():
    return types.ImageContent(data=PNG, mime_type="image/png")


async def _audio(context, arguments):
    return [types.AudioContent(data=WAV, mime_type="audio/wav")]


async def _embedded_resource(context, arguments):
    return [_embedded()]


async def _mixed(context, arguments):
    return [_text("Multiple content types test:"), _image(), _embedded("test://mixed")]


async def _logging(context, arguments):
    for text in ("Tool execution started", "Tool processing data", "Tool execution completed"):
        await context.session.send_log_message("info", text, related_request_id=context.request_id)
    return [_text("logged")]


async def _sampling(context, arguments):
    content = types.TextContent(text=arguments["prompt"])
    answer = await context.session.create_message(
        [types.SamplingMessage(role="user", content=content)],
        max_tokens=100,
        related_request_id=context.request_id,
    )
    return [_text(f"LLM response: {answer.content}")]


async def _elicitation(schema, context, arguments):
    answer = await context.session.elicit_form(
        arguments.get("message", "Please choose"),
        {"type": "object", "properties": schema},
        related_request_id=context.request_id,
    )
    return [_text(f"Elicitation completed: action={answer.action}, content={answer.content}")]


USER = {"username": {"type": "string"}, "email": {"type": "string"}}
DEFAULTS = {
    "name": {"type": "string", "default": "John Doe"},
    "age": {"type": "integer", "default": 30},
    "score": {"type": "number", "default": 95.5},
    "status": {
        "type": "string", "enum": ["active", "inactive", "pending"], "default": "active",
    },
    "verified": {"type": "boolean", "default": True},
}  # fmt: skip
TITLED = [{"const": f"value{number}", "title": f"Option {number}"} for number in (1, 2, 3)]
NAMES = ["option1", "option2", "option3"]
ENUMS = {
    "untitledSingle": {"type": "string", "enum": NAMES},
    "titledSingle": {"type": "string", "oneOf": TITLED},
    "legacyEnum": {"type": "string", "enum": NAMES, "enumNames": ["One", "Two", "Three"]},
    "untitledMulti": {"type": "array", "items": {"type": "string", "enum": NAMES}},
    "titledMulti": {"type": "array", "items": {"anyOf": TITLED}},
}
CALLS = {
    "test_audio_content": _audio,
    "test_embedded_resource": _embedded_resource,
    "test_multiple_content_types": _mixed,
    "test_tool_with_logging": _logging,
    "test_sampling": _sampling,
    "test_elicitation": partial(_elicitation, USER),
    "test_elicitation_sep1034_defaults": partial(_elicitation, DEFAULTS),
    "test_elicitation_sep1330_enums": partial(_elicitation, ENUMS),
}
PROMPTS = {
    "test_simple_prompt": ((), lambda arguments: [_text("This is a simple prompt for testing.")]),
    "test_prompt_with_arguments": (
        ("arg1", "arg2"),
        lambda arguments: [
            _text(f"Prompt with arguments: arg1='{arguments['arg1']}', arg2='{arguments['arg2']}'")
        ],
    ),
    "test_prompt_with_embedded_resource": (
        ("resourceUri",),
        lambda arguments: [
            _embedded(arguments["resourceUri"]),
            _text("Please process the embedded resource above."),
        ],
    ),
    "test_prompt_with_image": (
        (),
        lambda arguments: [_image(), _text("Please analyze the image above.")],
    ),
}


async def _list_prompts(context, params):
    prompts = [
        types.Prompt(
            name=name,
            description=name,
            arguments=[types.PromptArgument(name=each, required=True) for each in arguments],
        )
        for name, (arguments, _) in PROMPTS.items()
    ]
    return types.ListPromptsResult(prompts=prompts)


async def _get_prompt(context, params):
    contents = PROMPTS[params.name][1](params.arguments or {})
    return types.GetPromptResult(
        messages=[types.PromptMessage(role="user", content=content) for content in contents]
    )


async def _complete(context, params):
    return types.CompleteResult(completion=types.Completion(values=[], total=0, has_more=False))


async def _set_level(context, params):
    return types.EmptyResult()


def add_handlers(server):
    """Add what the suite calls and `minerva mcp` does not offer to its server."""
    call = server.get_request_handler("tools/call").handler
    listing = server.get_request_handler("tools/list").handler
    read = server.get_request_handler("resources/read").handler

    async def list_tools(context, params):
        listed = await listing(context, params)
        more = [
            types.Tool(name=name, description=name, input_schema={"type": "object"})
            for name in CALLS
        ]
        return types.ListToolsResult(tools=[*listed.tools, *more])

    async def call_tool(context, params):
        if params.name in CALLS:
            content = await CALLS[params.name](context, params.arguments or {})
            return types.CallToolResult(content=content)
        return await call(context, params)

    async def read_resource(context, params):
        uri = str(params.uri)
        if uri == "test://static-binary":
            content = types.BlobResourceContents(uri=uri, mime_type="image/png", blob=PNG)
        elif uri.startswith("test://template/"):
            text = f'{{"id": "{uri.split("/")[3]}"}}'
            content = types.TextResourceContents(uri=uri, mime_type="application/json", text=text)
        else:
            return await read(context, params)
        return types.ReadResourceResult(contents=[content])

    page = types.PaginatedRequestParams
    for method, params, handler in (
        ("tools/list", page, list_tools),
        ("tools/call", types.CallToolRequestParams, call_tool),
        ("resources/read", types.ReadResourceRequestParams, read_resource),
        ("prompts/list", page, _list_prompts),
        ("prompts/get", types.GetPromptRequestParams, _get_prompt),
        ("completion/complete", types.CompleteRequestParams, _complete),
        ("logging/setLevel", types.SetLevelRequestParams, _set_level),
    ):
        server.add_request_handler(method, params, handler)


def _connect(world):
    with ExitStack() as stack:
        return Live(OnBus(stack.enter_context(client(WorldTarget(world=world))), stack), [])


def main(world):
    """Serve a running world at a free port, until a signal arrives."""
    link = WorldConnection(lambda: _connect(world))
    served = WorldServer(link, frozenset(), Path(), tools=TOOLS, resources=(*RESOURCES, *STATIC))
    add_handlers(served.server)
    try:
        serve_http(served, "127.0.0.1", 0, partial(print, flush=True))
    finally:
        link.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
