"""`minerva check`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from minerva_bus.api.checking import check
from minerva_bus.cli.output import print_json, print_message, print_result
from minerva_bus.errors import MinervaError, SceneError


def check_file(file: Path, vocabulary: str, as_json: bool, *, code: bool = True) -> int:
    """Check a file, running its code only if `code` is true; returns the exit code."""
    answer: dict[str, Any] = {"file": str(file), "ok": True}
    try:
        checked = check(file, vocabulary=vocabulary, code=code)
        answer["what"] = checked.what
        answer |= {"code": checked.code} if not code and file.suffix == ".toml" else {}
        answer |= {"warnings": checked.warnings} if checked.warnings else {}
    except MinervaError as error:
        answer |= {"ok": False, "error": str(error)}
        if isinstance(error, SceneError):
            answer |= {"line": error.line, "column": error.column, "expected": error.expected}
    if as_json:
        print_json(answer)
    elif answer["ok"]:
        print_result(f"{file}: {answer['what']}")
        for name in answer.get("code", []):
            print_result(f"  not run: {name}")
        for warning in answer.get("warnings", []):
            print_message(f"warning: {warning}")
    else:
        print_message(answer["error"])
    return 0 if answer["ok"] else 1
