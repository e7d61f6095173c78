"""Forks a process for each command line that it reads, as JSON: the file for the output, and words.

It prints the exit code of each. The imports below are those that every command needs.
"""

import json
import os
import sys
from contextlib import redirect_stdout, suppress

import minerva_bus.api.checking
import minerva_bus.cli.run_choice
import minerva_bus.launch.past  # noqa: F401  (so that forks need not import it all)
from minerva_bus.cli.main import app, main


def forked(output: str, *words: str) -> int:
    """The exit code of a command that writes to this file."""
    pid = os.fork()
    if not pid:
        code = 1
        try:
            descriptor = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(descriptor, 1)
            os.dup2(descriptor, 2)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
            sys.argv = ["minerva", *words]
            main()
            code = 0
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(bool(ended.code))
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    _, status = os.waitpid(pid, 0)
    return os.waitstatus_to_exitcode(status)


# Trigger the lazy imports of the command line before the forks.
with suppress(SystemExit), redirect_stdout(sys.stderr):
    app(["check", "nothing.mnv"])
for line in sys.stdin:
    print(forked(*json.loads(line)), flush=True)
