"""`minerva check`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from minerva_bus.cli.output import print_message, print_result
from minerva_bus.errors import MinervaError, SceneError, WorldFileError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import walk
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.restless import restless
from minerva_bus.launch.specs import load
from minerva_bus.launch.structure import structure_of
from minerva_bus.wording import counted


def check_file(file: Path, vocabulary: str, as_json: bool, *, code: bool = True) -> int:
    """Check a file, running its code only if `code` is true; returns the exit code."""
    found: dict[str, Any] = {"file": str(file), "ok": True}
    try:
        if not code and file.suffix == ".toml":
            found["what"], found["code"] = _check_structure(file)
            warnings: list[str] = []
        else:
            found["what"], warnings = _check(file, vocabulary)
        found |= {"warnings": warnings} if warnings else {}
    except MinervaError as error:
        found |= {"ok": False, "error": str(error)}
        if isinstance(error, SceneError):
            found |= {"line": error.line, "column": error.column, "expected": error.expected}
    if as_json:
        print_result(json.dumps(found))
    elif found["ok"]:
        print_result(f"{file}: {found['what']}")
        for name in found.get("code", []):
            print_result(f"  not run: {name}")
        for warning in found.get("warnings", []):
            print_message(f"warning: {warning}")
    else:
        print_message(found["error"])
    return 0 if found["ok"] else 1


def _check_structure(file: Path) -> tuple[str, list[str]]:
    """A description of a world file without running code, and the code that it names."""
    found = structure_of(file)
    string = "a string that code makes" if found.string is None else _size(found.string)
    processes = counted(len(found.processes), "process")
    return f"a world of {processes}, {string}; no code was run", list(found.code)


def _check(file: Path, vocabulary: str) -> tuple[str, list[str]]:
    """A description of a file, and warnings."""
    if file.suffix == ".toml":
        world = read_world_file(file)
        processes = counted(len(world.processes), "process")
        return f"a world of {processes}, {_size(world.world.scene)}", restless(world)
    text = _read(file)
    if vocabulary:
        alphabet = load(vocabulary, file.resolve().parent)
        if not isinstance(alphabet, Vocabulary):
            raise WorldFileError(
                f"{vocabulary} names a {type(alphabet).__name__}, not a Vocabulary"
            )
        return f"a string of its vocabulary, {_size(alphabet.read(text, str(file)))}", []
    return f"a string of L(M), {_size(parse(text, str(file)))}", []


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WorldFileError(f"{file}: not a text in UTF-8") from None
    except OSError as error:
        raise WorldFileError(f"{file}: {error.strerror}") from None


def _size(scene: Any) -> str:
    count = sum(1 for opens, _ in walk(scene) if opens)
    return counted(count, "symbol")
