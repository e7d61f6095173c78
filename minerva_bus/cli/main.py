"""`minerva`: run worlds, attach to them, ask them, check files.

What a command's options are is in cli/commands, and nothing else is imported at first: `minerva
--help` has to be quick.
"""

from __future__ import annotations

import errno
import os
import sys

import typer

from minerva_bus.cli.commands import development, records, runs, studies, worlds
from minerva_bus.cli.exit_codes import INTERRUPTED, WRONG
from minerva_bus.cli.keying import app as keys
from minerva_bus.cli.promised import promised
from minerva_bus.errors import MinervaError
from minerva_bus.outputs import forget_inputs

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Virtual worlds as strings of a grammar, run by many processes on Zenoh.",
    epilog="Exit codes: 0 done, 1 a check or a world failed, 2 wrong input, 130 interrupted.",
)
for commands in (runs, worlds, records, studies, development):
    app.add_typer(commands.app)
app.add_typer(keys, name="keys")


def main() -> None:
    """Run the command line; errors are one message and an exit code, never a traceback."""
    try:
        forget_inputs()
        with promised(sys.argv[1:]):
            app()
    except MinervaError as error:
        print(f"minerva: {error}", file=sys.stderr)  # noqa: T201
        sys.exit(WRONG)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        os._exit(INTERRUPTED)  # The terminal was closed: there is nobody to print for.


if __name__ == "__main__":
    main()
