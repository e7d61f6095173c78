"""What a page shows about an agent: its state, what it received, and the causes of its values.

Causes are explained by `minerva explain`, in a process of its own: that runs code of agents, which
must not stop the page's server. For a replay it reads the record that is replayed.
"""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.printer import shown_value
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.world.services import WorldInfo

MAX_SECONDS: Final = 120.0
"""Time limit of an explanation in seconds; on a busy machine it takes long."""

MAX_PROCESSES: Final = 2
"""Explanations that are computed at the same time, for all pages."""


@dataclass(frozen=True, slots=True)
class AgentQuestion:
    """An agent, an attribute or "" for all, and a frame or None for the latest recorded one."""

    agent: str
    attribute: str = ""
    frame: int | None = None

    def plain(self) -> dict[str, Any]:
        """As a JSON object, by which a page finds the question of an answer."""
        return {"agent": self.agent, "attribute": self.attribute, "frame": self.frame}


class Inspector:
    """Answers questions of pages about agents of one world."""

    def __init__(self, world: WorldInfo) -> None:
        self._world = world
        self._processes = asyncio.Semaphore(MAX_PROCESSES)

    def state(self, agent: str) -> dict[str, Any]:
        """The present state of an agent: `kind` and `state`, by name. Raises MinervaError."""
        scene = self._world.vocabulary.read(self._world.operator.fragment(agent))
        node = scene.nodes[0] if scene.nodes else None
        if not isinstance(node, AgentNode):
            raise MisuseError(f"there is no agent #{agent[:64]}")
        state = {name: shown_value(node.state[name]) for name in node.names}
        return {"agent": node.id, "kind": node.symbol, "state": state}

    async def explain(self, question: AgentQuestion) -> dict[str, Any]:
        """The answer of `minerva explain`, as a JSON object.

        Raises MinervaError if the frame is no longer available, or has no such agent or attribute.
        """
        status = await asyncio.to_thread(self._world.operator.status)
        replayed = [file.path for file in status.files if status.end]
        async with self._processes:
            return await _explained(replayed[0] if replayed else status.world, question)


async def _explained(about: str, question: AgentQuestion) -> dict[str, Any]:
    words = ["explain", about, f"--agent={question.agent}", "--json"]
    words += [f"--attribute={question.attribute}"] if question.attribute else []
    words += [f"--frame={question.frame}"] if question.frame is not None else []
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "minerva_bus",
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        output, errors = await asyncio.wait_for(process.communicate(), MAX_SECONDS)
    except TimeoutError:
        raise MinervaError(f"no explanation within {MAX_SECONDS:g} s") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    try:
        answer = json.loads(output)
    except ValueError:
        text = errors.decode(errors="replace").strip() or "minerva explain failed"
        raise MinervaError(text) from None
    if "error" in answer:
        raise MinervaError(str(answer["error"]))
    return answer
