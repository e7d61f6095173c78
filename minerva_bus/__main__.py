"""`minerva` and `python -m minerva_bus`: the command line, which may be interrupted at any time."""

import os

TYPE_CHECKING = False  # As typing has it, which would be read first.
if TYPE_CHECKING:
    import signal
else:
    import _signal as signal  # signal itself imports enum, and may be interrupted in that

INTERRUPTED = 130
"""As cli/exit_codes.py has it, which may not be there yet."""


def leave(number: int, frame: object) -> None:
    """End at once: an exception in the midst of an import is a traceback, or is swallowed."""
    os._exit(INTERRUPTED)


if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave)


def main() -> None:
    """Run the command line; Ctrl-C is no traceback, also while its modules are read."""
    try:
        from minerva_bus.cli.main import main as run

        if signal.getsignal(signal.SIGINT) is leave:
            signal.signal(signal.SIGINT, signal.default_int_handler)
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    run()


if __name__ == "__main__":
    main()
