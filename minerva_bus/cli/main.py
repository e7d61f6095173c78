"""`minerva`: the command line.

Each command is a function in cli/commands, with examples; to add one, write the function and list
its name here. Those modules are imported when one of their commands is used, and declare options
and import little else, because `minerva --help` has to be fast. Extensions add commands by entry
points: functions of the same kind, or a `typer.Typer` as a group. The constant `TOPIC` of a module
is the topic of its commands in the help.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from inspect import signature
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any, Final, cast

import typer

from minerva_bus.cli.command_classes import (
    TAKES_OTHERS,
    Group,
    OtherOptionsCommand,
    WorldFirstCommand,
    answer_fast,
)
from minerva_bus.cli.output import (
    INTERRUPTED,
    WRONG,
    print_error,
    print_result,
    printing_damage,
    promised,
)
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.files import forget_inputs, reason_of
from minerva_bus.process_life import ended_by_system, limit_threads
from minerva_bus.uncaught import repeat_interrupts, report_threads

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

COMMANDS: Final = {
    "worlds": ("worlds", "run", "check", "attach"),
    "observing": ("list", "logs", "echo"),
    "operating": ("pub", "pause", "resume", "step", "rate", "restart", "drain", "stop"),
}
"""The kernel's commands by module of cli/commands, in the order of the help."""
_MODULES: Final = {
    name: f"minerva_bus.cli.commands.{module}"
    for module, names in COMMANDS.items()
    for name in names
}
FIRST: Final = ("worlds", "run", "new", "doctor")
"""The commands of the first topic, which are in none other."""
TOPICS: Final = (
    "First steps",
    "Run",
    "Observe",
    "Control",
    "Records",
    "Set up",
    "Studies",
    "Develop",
)
"""Topics in the order of the help; others follow."""
FURTHER: Final = "minerva.commands"
"""The entry points of further commands."""


def topics() -> dict[str, list[str]]:
    """All commands by topic, in the order of the help."""
    by_topic: dict[str, list[str]] = {topic: [] for topic in TOPICS}
    modules = {name: import_module(module) for name, module in _MODULES.items()}
    for name, entry in sorted(_further().items()):
        modules[name] = _loaded(name, import_module, entry.module)
    for name, module in modules.items():
        by_topic.setdefault(TOPICS[0] if name in FIRST else module.TOPIC, []).append(name)
    return {topic: names for topic, names in by_topic.items() if names}


def _further() -> Mapping[str, EntryPoint]:
    from minerva_bus.entry_points import entries

    return entries(FURTHER)


def _loaded(name: str, load: Callable[..., Any], *arguments: Any) -> Any:
    """What `load` imports for a command. Raises MinervaError for a package that fails."""
    try:
        return load(*arguments)
    except Exception as error:
        package = _further()[name].value
        raise MinervaError(
            f"the command {name} of {package} cannot be imported: {type(error).__name__}: {error};"
            " reinstall or uninstall its package"
        ) from error


class _Commands(Group):
    """Makes a command when it is used, and lists all by topic."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = cast("dict[str, Any]", _Made())

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        width = max(map(len, self.commands))
        for topic, names in topics().items():
            with formatter.section(topic):
                limit = formatter.width - width - 6
                formatter.write_dl(
                    [(f"{n:{width}}", self.commands[n].get_short_help_str(limit)) for n in names]
                )


class _Made(Mapping[str, Any]):
    """The commands by name; each is made at its first use, because 40 of them take long."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in _MODULES and name not in _further():
            raise KeyError(name)
        if name not in self._made:
            self._made[name] = _make(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return chain(_MODULES, sorted(_further()))

    def __len__(self) -> int:
        return len(_MODULES) + len(_further())


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="Exit codes: 0 done, 1 a check or a world failed, 2 wrong input, 130 interrupted.",
)


def command_of(name: str) -> Callable[..., None] | typer.Typer:
    """The function that declares a command."""
    if name not in _MODULES:
        return _loaded(name, _further()[name].load)
    module = import_module(_MODULES[name])
    # `list_`, because `list` is a type of an option.
    return getattr(module, f"{name}_", None) or getattr(module, name)


def _make(name: str) -> Any:
    """The command of a name."""
    from minerva_bus.cli.options import examples_of  # It reads all settings.

    function = command_of(name)
    if isinstance(function, typer.Typer):
        group = typer.main.get_group(function)
        group.name = name
        return group
    # Such a command reads `context.args`; without it, misspelt options would be ignored.
    takes_others = "context" in signature(function).parameters
    single = typer.Typer(rich_markup_mode=None, add_completion=False)
    single.command(
        name,
        cls=OtherOptionsCommand if takes_others else WorldFirstCommand,
        context_settings=TAKES_OTHERS if takes_others else None,
        epilog="\n".join(("\b", "Examples:", *(f"  {line}" for line in examples_of(function)))),
    )(function)
    return typer.main.get_command(single)


def _print_version(wanted: bool) -> None:
    if wanted:
        from minerva_bus import __version__

        print_result(f"minerva-bus {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Run virtual worlds: strings of a grammar, distributed over processes on Zenoh."""


_FULL: Final = (errno.ENOSPC, errno.EDQUOT)
"""Errors of writing that no code of ours can have caused."""

_LIMITS: Final = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)
"""Errors of a system that gives no more files, processes or memory."""


def _refuse_null_characters(words: Sequence[str]) -> None:
    # A shell cannot pass them, but a program that calls `main` can; no file name contains them.
    for word in words:
        if "\0" in word:
            raise MisuseError(f"the argument {word[:60]!r} contains a null character; remove it")


def _problem(error: OSError) -> str:
    """What the system refused, in one line; errors of sockets and the like keep their traceback."""
    name = "" if error.filename is None else str(error.filename)
    if error.errno == errno.EIO and not name:
        os._exit(INTERRUPTED)  # The terminal was closed, so nothing can be printed.
    if error.errno == errno.ENAMETOOLONG:
        return f"the file name {name[:60]!r}... is too long"
    if error.errno in _FULL:
        return f"{name or 'the output'} cannot be written: {reason_of(error)}"
    if not name and error.errno not in _LIMITS:
        raise error
    return f"{name or 'this system'}: {error.strerror}"


def main() -> None:
    """Run the command line; errors are one message and an exit code, never a traceback."""
    # In units of log2 of processor cycles. Otherwise, the threads of numpy's linear algebra keep a
    # core busy for 30 ms after numpy is imported, and after each use.
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
    try:
        _run()
    except SystemExit as ended:
        limit_threads(ended.code if isinstance(ended.code, int) else int(bool(ended.code)))
        raise
    limit_threads(0)


def _run() -> None:
    try:
        # A process may run several commands, as tests do; the inputs of one are not those of the
        # next.
        forget_inputs()
        report_threads()
        repeat_interrupts()
        answer_fast()
        with promised(sys.argv[1:]), printing_damage():
            _refuse_null_characters(sys.argv[1:])
            app()
    except MinervaError as error:
        print_error(str(error))
        sys.exit(WRONG)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except UnicodeEncodeError as error:
        # An old locale; escapes would be other text where the output is a string or a table.
        lacking = f"{error.encoding} has no {error.object[error.start]!a}"
        print_error(f"the output cannot be written: {lacking}; set PYTHONIOENCODING=utf-8")
        sys.exit(WRONG)
    except ValueError:
        if not sys.stdout.closed:
            raise
        print_error("the output cannot be written: code of the world has closed sys.stdout")
        sys.exit(WRONG)
    except BrokenPipeError:
        # The reader of a pipe, such as `head`, has closed it: it needs no more.
        sys.exit(0)
    except OSError as error:
        print_error(_problem(error))
        sys.exit(WRONG)


if __name__ == "__main__":
    with ended_by_system():
        main()
