"""Options of a world or a service, which typer does not know."""

from __future__ import annotations

from minerva_bus.errors import MinervaError


def options_of(words: list[str]) -> dict[str, str]:
    """Parse `--name value` and `--name=value` pairs. Raises MinervaError."""
    options: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--") or not name:
            raise MinervaError(f"what is {word!r}? Expected options such as --name value")
        if not equals:
            if not rest:
                raise MinervaError(f"--{name} needs a value")
            value = rest.pop(0)
        options[name.replace("-", "_")] = value
    return options
