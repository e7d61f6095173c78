"""Digests of the code of a world, to detect that it has changed since a study began.

They are of functions and classes as loaded, not of files: a comment changes nothing, and a module
that was edited after its import counts as what runs. The installed packages of Minerva Bus count by
their version, other installed packages not at all.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from hashlib import blake2b
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, cast

import numpy as np

import minerva_bus
from minerva_bus.entry_points import OWN
from minerva_bus.errors import MinervaError
from minerva_bus.grammar.vocabulary import EventType, Primitive, Transformation
from minerva_bus.launch.specs import load
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.user_code import variables_of
from minerva_bus.wording import named_some

VERSION: Final = "Minerva Bus"
PYTHON: Final = "Python"
SETTINGS: Final = "file"
STRING: Final = "string"
VOCABULARY: Final = "vocabulary"
CODE: Final = "code"
MAX_NAMES: Final = 5

SPEC: Final = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")
"""A text that may name an attribute, `module:attribute`."""

MAX_DEPTH: Final = 12
_PLAIN: Final = (type(None), type(...), bool, int, float, complex, str, bytes, np.generic)
_SKIPPED: Final = re.compile(
    r"__(module|dict|weakref|doc|qualname|firstlineno|static_attributes)__|_abc_impl"
)


def identity(tables: Mapping[str, Any], file: WorldFile, roots: Iterable[object]) -> dict[str, Any]:
    """What must be the same for two runs of a world to have the same result, as digests.

    `tables` are those of the world file, `file` is the world with the settings of all runs, `roots`
    are its `named_objects`.
    """
    return {
        VERSION: minerva_bus.__version__,
        # Digests of code are of bytecode, which depends on it.
        PYTHON: ".".join(map(str, sys.version_info[:2])),
        SETTINGS: digest_of(tables),
        STRING: file.world.scene.digest.hex(),
        VOCABULARY: digest_of(file.world.vocabulary),
        CODE: code_digests(roots),
    }


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What differs in two identities with further keys, as phrases."""
    phrases: list[str] = []
    for key, value in now.items():
        former = before.get(key)
        if former == value:
            continue
        if key == CODE:
            names = changed(cast("Mapping[str, str]", former or {}), value)
            phrases.append(f"the code of {named_some(names, MAX_NAMES)}")
        elif key in (SETTINGS, STRING, VOCABULARY):
            phrases.append(f"the world's {key}")
        else:
            phrases.append(f"{key} {former}, now {value}")
    return phrases


def code_digests(roots: Iterable[object]) -> dict[str, str]:
    """Digests of functions, classes and constants, by `module.name`.

    `roots` are classes, functions and modules; what their code refers to by name is included, as
    far as it belongs to their packages or to no installed one.
    """
    walk, known = _Walk(), list(roots)
    walk.packages.update(map(_package, known))
    for root in known:
        walk.add(root)
    return dict(sorted(walk.digests.items()))


def digest_of(value: object) -> str:
    """A digest of plain data, symbols and vocabularies."""
    return _digest(_Walk().value(value))


def named_objects(tables: object, folder: Path) -> list[object]:
    """The objects that the texts of a world's tables name, such as `meadow:Fox`."""
    objects: list[object] = []
    for text in _texts(tables):
        if SPEC.fullmatch(text):
            try:
                value = load(text, folder)
            except MinervaError:
                continue  # It is a text of another kind, or reading the world reports it.
            objects.append(value.func if isinstance(value, partial) else value)
    return objects


def changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """The names whose code has been changed, added or removed."""
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    # A class changes with its methods, which say more.
    return [name for name in names if not any(each.startswith(f"{name}.") for each in names)]


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in cast("Mapping[str, object]", value).values():
            yield from _texts(item)
    elif isinstance(value, list | tuple):
        for item in cast("Iterable[object]", value):
            yield from _texts(item)


class _Walk:
    """Visits code that refers to other code."""

    def __init__(self) -> None:
        self.digests: dict[str, str] = {}
        self.packages: set[str] = set()

    def add(self, value: object) -> None:
        """Add a class or function, with what its code refers to."""
        if isinstance(value, FunctionType | type) and self._is_own(value):
            name = f"{value.__module__}.{value.__qualname__}"
            if name not in self.digests:
                self.digests[name] = ""  # Classes may refer to each other.
                self.digests[name] = _digest(self._described(value))

    def _is_own(self, value: object) -> bool:
        package = _package(value)
        if package.startswith(OWN):
            return False
        return package in self.packages or not _installed(package)

    def _described(self, value: FunctionType | type) -> object:
        return self._function(value) if isinstance(value, FunctionType) else self._class(value)

    def _class(self, cls: type) -> object:
        own = sorted(
            (name, value) for name, value in vars(cls).items() if not _SKIPPED.fullmatch(name)
        )
        parts: list[object] = [[self.value(base) for base in cls.__bases__]]
        parts += [(name, self._member(value)) for name, value in own]
        return parts

    def _member(self, value: object) -> object:
        if isinstance(value, staticmethod | classmethod):
            return self._member(cast("Any", value).__func__)
        if isinstance(value, property):
            return [self._member(each) for each in (value.fget, value.fset)]
        if isinstance(value, FunctionType) and self._is_own(value):
            return self._function(value)
        return self.value(value)

    def _function(self, function: FunctionType) -> object:
        cells = list(variables_of(function).values())
        given = (function.__defaults__, function.__kwdefaults__, cells, vars(function))
        return self._code(function.__code__, function), self.value(given)

    def _code(self, code: CodeType, function: FunctionType) -> object:
        names = function.__globals__
        used = [(name, self._global(names[name], code)) for name in code.co_names if name in names]
        # The docstring is the first constant.
        consts = [
            self._code(const, function) if isinstance(const, CodeType) else self.value(const)
            for const in code.co_consts
            if const is not function.__doc__
        ]
        return code.co_code, code.co_names, code.co_varnames, code.co_flags, consts, used

    def _global(self, value: object, code: CodeType) -> object:
        if not isinstance(value, ModuleType):
            return self.value(value)
        if not self._is_own(value):
            return value.__name__
        # Names of attributes are not told apart from others: one too many does no harm.
        inner = [(name, vars(value)[name]) for name in code.co_names if name in vars(value)]
        return value.__name__, [(name, self.value(each)) for name, each in inner]

    def value(self, value: object, depth: int = 0) -> object:
        """A value as nested lists of plain data; classes and functions by name."""
        if isinstance(value, _PLAIN):
            return cast("object", value)
        if isinstance(value, FunctionType | type):
            self.add(value)
            return value.__module__, value.__qualname__
        if isinstance(value, Primitive | Transformation | EventType):
            return type(value).__qualname__, value.name, self.value(value.fields, depth + 1)
        if depth > MAX_DEPTH:
            return type(value).__qualname__
        if isinstance(value, np.ndarray):
            array = cast("np.ndarray[Any, Any]", value)
            data = array.tolist() if array.dtype.hasobject else array.tobytes()
            return str(array.dtype), array.shape, data
        if isinstance(value, list | tuple):
            return [self.value(each, depth + 1) for each in cast("Iterable[object]", value)]
        if isinstance(value, set | frozenset):
            items = cast("Iterable[object]", value)
            return sorted(repr(self.value(each, depth + 1)) for each in items)
        if isinstance(value, Mapping):
            pairs = cast("Mapping[object, object]", value).items()
            return [(repr(key), self.value(each, depth + 1)) for key, each in pairs]
        if is_dataclass(value):
            values = [getattr(value, field.name, None) for field in fields(value)]
            return type(value).__qualname__, [self.value(each, depth + 1) for each in values]
        # Other objects, such as random generators, change while they are used.
        return type(value).__module__, type(value).__qualname__


def _digest(described: object) -> str:
    # The module of a world made in Python is numbered by its order of creation.
    text = re.sub(r"minerva_world_\d+", "minerva_world", repr(described))
    return blake2b(text.encode(), digest_size=8).hexdigest()


def _package(value: object) -> str:
    name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", "")
    return str(name).partition(".")[0]


@cache
def _installed(package: str) -> bool:
    """Whether a package belongs to Python or to its installed libraries."""
    if package in sys.stdlib_module_names:
        return package != "__main__"
    try:
        file = getattr(import_module(package), "__file__", None)
    except Exception:
        return False
    paths = {sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")}
    return file is not None and any(Path(file).is_relative_to(path) for path in paths)
