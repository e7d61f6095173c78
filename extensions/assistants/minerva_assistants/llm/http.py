"""A backend that speaks the API of OpenAI, as local and remote servers of models do."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from typing import Any, Final, cast
from urllib.parse import urlsplit

from minerva_assistants.llm.backends import BackendError, Completion, Prompt, Unavailable
from minerva_assistants.llm.streams import limited, streamed_reply
from minerva_bus.errors import MisuseError

MAX_DETAIL: Final = 200
PASSING: Final = frozenset((408, 409, 425, 429, 500, 502, 503, 504, 529))
"""Statuses after which the same call may succeed."""


class HttpBackend:
    """Chat completions of the server at a base URL, such as `http://localhost:11434/v1`.

    Args:
        url: the base URL.
        model: the model's name; the first one that the server lists if empty.
        read_key: returns the API key, or the empty text; called before the first call.
        parameters: further members of the request's JSON object, such as `temperature`.
        stream: whether the server sends its answer in pieces.
        first_token: seconds until the first piece of a streamed answer; 0: any time.

    """

    scripted = False

    def __init__(
        self,
        url: str,
        model: str,
        read_key: Callable[[], str],
        parameters: Mapping[str, Any],
        *,
        stream: bool = False,
        first_token: float = 0.0,
    ) -> None:
        if not _is_base(url):
            raise MisuseError(
                "llm: backend must be a base URL such as http://localhost:11434/v1, without"
                " user or query; set the key by key_env or key_file"
            )
        self.name = f"{url.rstrip('/')} {model} {json.dumps(dict(parameters), sort_keys=True)}"
        self._url, self._model = url.rstrip("/"), model
        self._read_key, self._key = read_key, ""
        self._parameters = parameters
        self._stream, self._first_token = stream, first_token
        self._open: Any = None

    async def complete(self, prompt: Prompt) -> Completion:
        """Raises BackendError."""
        if not self._model:
            self._model = _first_model(await self._call("GET", "/models"))
        form = {"name": prompt.request.answer, "schema": prompt.schema, "strict": True}
        # A strict schema would exclude the calls of tools.
        strict = {"type": "json_schema", "json_schema": form}
        asked = {
            "model": self._model,
            "messages": prompt.messages,
            "response_format": {"type": "json_object"} if prompt.has_tools else strict,
            **self._parameters,
        }
        if self._stream:
            asked |= {"stream": True, "stream_options": {"include_usage": True}}
        reply = await self._call("POST", "/chat/completions", asked, stream=self._stream)
        return _completion(reply, self._model)

    async def close(self) -> None:
        """Close all connections."""
        if self._open is not None:
            await self._open.aclose()

    async def _call(self, method: str, path: str, body: Any = None, *, stream: bool = False) -> Any:
        # Imported late: only this backend needs the extra.
        import httpx

        if self._open is None:
            self._key = self._read_key()
            headers = {"Authorization": f"Bearer {self._key}"} if self._key else {}
            # The caller limits the whole call; httpx would limit each read.
            self._open = httpx.AsyncClient(headers=headers, timeout=None)  # noqa: S113
        client: httpx.AsyncClient = self._open
        try:
            async with (
                asyncio.timeout((self._first_token or None) if stream else None) as limit,
                client.stream(method, self._url + path, json=body) as response,
            ):
                if stream and response.status_code < 300:
                    return await streamed_reply(response.aiter_bytes(), limit)
                content = await limited(response.aiter_bytes())
                # A redirection is not followed: the prompt and the key are for this server only.
                if response.status_code >= 300:
                    raise self._failure(response.status_code, response.headers, content)
        except TimeoutError:
            raise Unavailable(f"no first piece within {self._first_token:g} s") from None
        except httpx.HTTPError as error:
            raise Unavailable(self._safe(str(error) or type(error).__name__)) from None
        except httpx.InvalidURL as error:
            raise BackendError(self._safe(f"{self._url}: {error}")) from None
        try:
            return json.loads(content)
        except (ValueError, RecursionError):
            raise Unavailable(f"no JSON: {self._safe(content.decode(errors='replace'))}") from None

    def _failure(self, status: int, headers: Mapping[str, str], content: bytes) -> BackendError:
        detail = content.decode(errors="replace")
        if status < 400:
            detail = f"the server redirects to {headers.get('location', '?')}; set backend to it"
        reason = f"status {status}: {self._safe(detail)}"
        if status not in PASSING:
            return BackendError(reason)
        wait = headers.get("retry-after", "")
        return Unavailable(reason, float(wait) if wait.isdecimal() else 0.0)

    def _safe(self, text: str) -> str:
        """A text for messages: short, in one line, and without the key, which a server may echo."""
        hidden = text.replace(self._key, "(key)") if self._key else text
        return " ".join(hidden.split())[:MAX_DETAIL]


def _is_base(url: str) -> bool:
    """Whether a text is a URL with a host, a possible port, and neither user nor query."""
    try:
        parts = urlsplit(url)
        return bool(parts.hostname and parts.port != 0) and not (parts.username or parts.query)
    except ValueError:  # of an address or a port that cannot exist
        return False


def _first_model(listed: Any) -> str:
    try:
        return str(listed["data"][0]["id"])
    except (KeyError, IndexError, TypeError):
        raise BackendError("the server lists no models; set the option model") from None


def _completion(reply: Any, model: str) -> Completion:
    """Raises Unavailable if the reply has no text."""
    try:
        text = reply["choices"][0]["message"]["content"]
    except (KeyError, IndexError, TypeError):
        text = None
    if not isinstance(text, str):
        raise Unavailable("the reply has no text at choices[0].message.content")
    usage = cast("Any", reply).get("usage")
    return Completion(
        text, _count(usage, "prompt_tokens"), _count(usage, "completion_tokens"), model
    )


def _count(usage: Any, name: str) -> int:
    count = cast("dict[str, Any]", usage).get(name) if isinstance(usage, dict) else 0
    return count if isinstance(count, int) and 0 <= count < 1 << 40 else 0
