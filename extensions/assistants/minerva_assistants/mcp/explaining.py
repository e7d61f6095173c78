"""The tool that explains halts of the running world, and values of it and of records."""

from __future__ import annotations

from typing import Final

from minerva_analysis.explaining import explain_running_value, explain_world
from minerva_assistants.mcp.programs import SECONDS, input_file, run_command
from minerva_assistants.mcp.tool import AGENT_ID, Result, Tool, ToolCall, text, whole
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.launch.installed import installed_worlds


def _explain(call: ToolCall) -> Result:
    arguments = call.arguments
    if not {"file", "agent", "attribute"} & arguments.keys():
        return explain_world(call.link.live().operator).plain()
    who, what = arguments.get("agent", "").removeprefix("#"), arguments.get("attribute", "")
    missing = [name for name in ("agent", "attribute") if name not in arguments]
    if missing:
        raise MisuseError(f"explain needs `{missing[0]}`: whose value to explain")
    if "file" not in arguments:
        code = _installed(arguments["world"]) if "world" in arguments else None
        operator, frame = call.link.live().operator, arguments.get("frame")
        return explain_running_value(operator, code, who, what, frame).plain()
    words = ["explain", input_file(call, "file", ".mcap")]
    # The world file that a record names may be any, so its code is not run.
    words.append(_installed(arguments["world"]) if "world" in arguments else "--no-code")
    words += [f"--agent={who}", f"--attribute={what}"]
    words += [f"--frame={arguments['frame']}"] if "frame" in arguments else []
    return run_command(call, *words)


def _installed(name: str) -> str:
    installed = installed_worlds()
    if name not in installed:
        hint = nearest(name, [*installed]) or f"; there are {', '.join(installed)}"
        raise MisuseError(f"there is no installed world {name!r}{hint}")
    return name


EXPLAIN: Final = Tool(
    "explain",
    "Explain why the running world does not advance; or, with `agent` and `attribute`, how the"
    " attribute got its value, in the running world or in the record `file`: methods, events and"
    " senders, back to their origin.",
    _explain,
    {
        "file": text("Record (.mcap). Without it, the running world is explained."),
        "agent": text("Id of an agent.", pattern=AGENT_ID),
        "attribute": text("One of its attributes.", pattern="^[A-Za-z_][A-Za-z0-9_]*$"),
        "frame": whole("Explain the value at the beginning of this frame.", 0, 2**53),
        "world": text(
            "Installed world with the code of the agents. Without it, no code is run, and the"
            " explanation names events, but no methods."
        ),
        "seconds": SECONDS,
    },
    example={"file": "run.mcap", "agent": "r1", "attribute": "objective", "frame": 340},
)
