"""A backend of fixed answers: the first rule whose pattern occurs in the prompt.

    [[rules]]
    when = "hungry.*apples: (?P<apples>[0-9]+)"
    answer = { action = "eat", amount = "{apples}" }
    seconds = 2.5

Answers take simulated time, so a run with a script is deterministic.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from minerva_assistants.llm.backends import BackendError, Completion, Prompt
from minerva_assistants.llm.local import text_of
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import read_text

_PLACEHOLDER = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, slots=True)
class ScriptRule:
    """An answer to prompts that contain a pattern; its texts may name groups: `{apples}`.

    A list of answers is for consecutive attempts: the next one follows a rejected one.
    """

    when: re.Pattern[str]
    answers: tuple[Any, ...]
    seconds: float
    tokens: tuple[int, int]

    @staticmethod
    def of(table: Mapping[str, Any]) -> ScriptRule:
        """A rule from a table. Raises MisuseError."""
        known = ("when", "answer", "seconds", "tokens")
        for key in table:
            if key not in known:
                raise MisuseError(f"a rule has no {key!r}{nearest(key, list(known))}")
        if "answer" not in table:
            raise MisuseError("a rule needs an answer")
        try:
            pattern = re.compile(str(table.get("when", "")), re.DOTALL)
            seconds = float(table.get("seconds", 0.0))
            tokens_in, tokens_out = map(int, table.get("tokens", (0, 0)))
        except (re.error, TypeError, ValueError) as error:
            raise MisuseError(f"a rule is wrong: {error}") from None
        if not 0 <= seconds < float("inf"):
            raise MisuseError(f"seconds is {seconds}; expected a number from 0")
        answer = table["answer"]
        answers = tuple(cast("list[Any]", answer)) if isinstance(answer, list) else (answer,)
        return ScriptRule(pattern, answers, seconds, (tokens_in, tokens_out))


class ScriptBackend:
    """Answers by rules, in their order."""

    scripted = True

    def __init__(self, name: str, rules: Any) -> None:
        self.name = name
        tables = cast("list[Any]", rules) if isinstance(rules, list | tuple) else []
        if not tables or not all(isinstance(table, Mapping) for table in tables):
            raise MisuseError(f"llm: {name}: expected a list of rules, each a table")
        try:
            self._rules = tuple([ScriptRule.of(table) for table in tables])
        except MisuseError as error:
            raise MisuseError(f"llm: {name}: {error}") from None

    @staticmethod
    def read(path: Path) -> ScriptBackend:
        """The script in a TOML file. Raises MisuseError."""
        try:
            content = tomllib.loads(read_text(path))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise MisuseError(f"llm: script {path}: {reason}") from None
        return ScriptBackend(str(path), content.get("rules"))

    async def complete(self, prompt: Prompt) -> Completion:
        """Raises BackendError if no rule fits."""
        text = prompt.turns[0][1]
        for rule in self._rules:
            match = rule.when.search(text)
            if match is not None:
                attempt = min(len(prompt.turns) // 2, len(rule.answers) - 1)
                answer = text_of(_filled(rule.answers[attempt], match.groupdict("")))
                return Completion(answer, *rule.tokens, "script", rule.seconds)
        raise BackendError(f"{self.name}: no rule for {text[:60]!r}")

    async def close(self) -> None:
        """Nothing to release."""


def _filled(value: Any, groups: Mapping[str, str]) -> Any:
    """A value whose texts have groups of the pattern in place of `{name}`."""
    if isinstance(value, str):
        return _PLACEHOLDER.sub(lambda name: groups.get(name[1], name[0]), value)
    if isinstance(value, Mapping):
        table = cast("Mapping[str, Any]", value)
        return {key: _filled(item, groups) for key, item in table.items()}
    if isinstance(value, list):
        return [_filled(item, groups) for item in cast("list[Any]", value)]
    return value
