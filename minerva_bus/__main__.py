"""`minerva` and `python -m minerva_bus`: the command line, which may be interrupted at any time."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C is no traceback, also while its modules are read."""
    try:
        from minerva_bus.cli.main import main as run
    except KeyboardInterrupt:
        sys.exit(130)  # As cli/exit_codes.py has it, which may not be there yet.
    run()


if __name__ == "__main__":
    main()
