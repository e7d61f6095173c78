"""What a script, an interactive Python and a notebook show of an error that nobody catches.

A traceback through the framework has up to a hundred lines, of which the reader wrote two. The
report of `minerva_bus.user_code` names these. MINERVA_TRACEBACK=1 shows all frames.
"""

from __future__ import annotations

import _thread
import os
import sys
import time

TYPE_CHECKING = False  # Instead of typing.TYPE_CHECKING, because importing typing takes time.
if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from threading import ExceptHookArgs
    from types import TracebackType
    from typing import Final

VARIABLE: Final = "MINERVA_TRACEBACK"
"""The environment variable that asks for all frames."""


def install() -> None:
    """Print uncaught errors of Minerva Bus as reports; all others are printed as before.

    A program that has replaced `sys.excepthook` keeps its own.
    """
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _print


def report_threads() -> None:
    """Print errors that end threads of a world's code as reports, in a process of Minerva Bus."""
    import threading  # which a fast command such as `--help` does not need

    threading.excepthook = _print_of_thread


def repeat_interrupts() -> None:
    """Interrupt again if Ctrl-C came where Python cannot raise it, in a process of Minerva Bus.

    Such places are callbacks of import locks and `__del__`. Python prints the exception there and
    goes on.
    """
    sys.unraisablehook = _repeat


def rendered(error: BaseException) -> str:
    """The text to show of an error of Minerva Bus."""
    from minerva_bus.user_code import place_of, report, whole  # which import all error classes

    if os.environ.get(VARIABLE):
        return whole(error)
    rest: str = getattr(error, "rest", "")
    if rest:  # Its cause has been logged above.
        place = place_of(error)
        lines = [f"{rest} ({VARIABLE}=1 shows all frames)", *(place.lines() if place else ())]
    else:
        lines = [report(error)]
    return f"{type(error).__name__}: " + "\n".join(lines)


def _print_of_thread(uncaught: ExceptHookArgs) -> None:
    import threading

    from minerva_bus.user_code import place_of, report

    error, thread = uncaught.exc_value, uncaught.thread
    usual = isinstance(error, SystemExit) or bool(os.environ.get(VARIABLE))
    if usual or error is None or thread is None or sys.stderr is None or place_of(error) is None:
        threading.__excepthook__(uncaught)
        return
    sys.stderr.write(f"thread {thread.name!r} has ended: {report(error)}\n")


def _repeat(unraisable: UnraisableHookArgs) -> None:
    if unraisable.exc_type is KeyboardInterrupt:
        # Later, because the hook itself cannot raise it either.
        _thread.start_new_thread(_interrupt, ())
    else:
        sys.__unraisablehook__(unraisable)


def _interrupt() -> None:
    import signal  # which a fast command such as `--help` does not need
    import threading

    time.sleep(0.05)
    main = threading.main_thread().ident
    if main is not None:
        signal.pthread_kill(main, signal.SIGINT)


def _print(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    # The method by which a notebook asks an exception for its lines.
    render = getattr(error, "_render_traceback_", None)
    if not kind.__module__.startswith("minerva_") or render is None or sys.stderr is None:
        sys.__excepthook__(kind, error, trace)
        return
    sys.stderr.write("\n".join(render()) + "\n")
