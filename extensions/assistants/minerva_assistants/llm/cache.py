"""Former completions on disk, addressed by a hash of everything that was asked."""

from __future__ import annotations

import contextlib
import hashlib
import json
import secrets
from dataclasses import asdict
from pathlib import Path

from minerva_assistants.llm.backends import Completion, Prompt


class CompletionCache:
    """A folder with one file per completion; without a folder it keeps nothing."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder) if folder else None

    def find(self, backend: str, prompt: Prompt) -> Completion | None:
        """The completion of an equal prompt by the same backend, or None."""
        if self._folder is None:
            return None
        # A damaged file is as good as none.
        with contextlib.suppress(OSError, ValueError, TypeError):
            content = self._path(self._folder, backend, prompt).read_text(encoding="utf-8")
            return Completion(**json.loads(content))
        return None

    def keep(self, backend: str, prompt: Prompt, completion: Completion) -> None:
        """Write a completion. Raises OSError."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._path(self._folder, backend, prompt)
        # Several processes may share the folder, so a file appears when it is complete.
        partial = path.with_suffix(f".{secrets.token_hex(4)}.part")
        partial.write_text(json.dumps(asdict(completion)), encoding="utf-8")
        partial.replace(path)

    @staticmethod
    def _path(folder: Path, backend: str, prompt: Prompt) -> Path:
        asked = json.dumps([backend, prompt.messages, prompt.schema], sort_keys=True)
        return folder / f"{hashlib.blake2b(asked.encode(), digest_size=16).hexdigest()}.json"
