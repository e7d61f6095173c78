"""What a backend is: it completes a prompt, or fails."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from minerva_assistants.minds.mind import OpenRequest


@dataclass(frozen=True, slots=True)
class Prompt:
    """A request as a backend receives it.

    `turns` are role and text: the request first, then each rejected answer with the reason.
    `schema` is the JSON Schema of the answer; an answer may also call a tool if `has_tools`.
    """

    request: OpenRequest
    system: str
    turns: tuple[tuple[str, str], ...]
    schema: Mapping[str, Any] = field(default_factory=dict[str, Any])
    has_tools: bool = False

    @staticmethod
    def of(request: OpenRequest, system: str, schema: Mapping[str, Any], tools: str = "") -> Prompt:
        """The first prompt of a request; `system` and `tools` are common to all requests."""
        form = f"Answer with one JSON object, valid for this JSON Schema:\n{json.dumps(schema)}"
        parts = [system, request.system, form, tools]
        turns = (("user", request.prompt),)
        return Prompt(request, "\n\n".join(filter(None, parts)), turns, schema, bool(tools))

    def corrected(self, answer: str, reason: str) -> Prompt:
        """The prompt that follows a rejected answer."""
        again = f"This answer is invalid: {reason}. Answer again."
        return replace(self, turns=(*self.turns, ("assistant", answer), ("user", again)))

    def after_tool(self, answer: str, result: str) -> Prompt:
        """The prompt that follows the call of a tool."""
        return replace(self, turns=(*self.turns, ("assistant", answer), ("user", result)))

    @property
    def messages(self) -> list[dict[str, str]]:
        """The prompt in the form of the chat API."""
        turns = [{"role": role, "content": text} for role, text in self.turns]
        return [{"role": "system", "content": self.system}, *turns]


@dataclass(frozen=True, slots=True)
class Completion:
    """A backend's answer. `seconds` is the simulated duration of a scripted one."""

    text: str
    tokens_in: int = 0
    tokens_out: int = 0
    model: str = ""
    seconds: float = 0.0


class BackendError(Exception):
    """A call has failed for good; the text gives the reason."""


class Unavailable(BackendError):
    """A call has failed, but may succeed later, after at least `wait` seconds."""

    def __init__(self, reason: str, wait: float = 0.0) -> None:
        super().__init__(reason)
        self.wait = wait


class Backend(Protocol):
    """Completes prompts. All methods are called in the thread of one event loop."""

    @property
    def name(self) -> str:
        """What it is, for messages and as part of the key of cached completions."""
        ...

    @property
    def scripted(self) -> bool:
        """Whether it is a table whose answers take simulated time."""
        ...

    async def complete(self, prompt: Prompt) -> Completion:
        """The answer to a prompt. Raises BackendError."""
        ...

    async def close(self) -> None:
        """Release connections."""
        ...
