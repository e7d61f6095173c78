"""`minerva` and `python -m minerva_bus`: start the command line, interruptible at any time."""

import os
import sys

TYPE_CHECKING = False  # Instead of typing.TYPE_CHECKING, because importing typing takes time.
if TYPE_CHECKING:
    import signal
else:
    import _signal as signal  # signal imports enum, during which Ctrl-C would be a traceback

INTERRUPTED = 130
"""The value of cli/output.py, which may not be imported yet."""


def leave(number: int, frame: object) -> None:
    """Exit at once: an exception during an import is printed as a traceback, or is swallowed."""
    os._exit(INTERRUPTED)


# A signal that is ignored, as in the background of a shell script, stays ignored.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave)


def open_standard_files() -> None:
    """Open standard files that the caller has closed, as on `>&-`, so that they have a file each.

    Otherwise the next file that is opened would get the output.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # The system gives the lowest free number.
            os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(number, True)
            setattr(sys, name, open(number, "w" if number else "r", closefd=False))  # noqa: SIM115


def main() -> None:
    """Run the command line; Ctrl-C exits quietly, also during imports."""
    open_standard_files()
    try:
        from minerva_bus.process_life import ended_by_system, uncollected

        with uncollected():
            from minerva_bus.cli.main import main as run
        if signal.getsignal(signal.SIGINT) is leave:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    with ended_by_system():
        run()


if __name__ == "__main__":
    main()
