"""The member that the conformance suite expects, as a program.

    minerva conformance --role host -- python -m minerva_conformance

Its role, world, endpoint and name come from the environment, as for any member under test.
"""

from __future__ import annotations

import os
import sys

from minerva_bus.errors import MinervaError
from minerva_bus.runtime.participants import MemberProcess
from minerva_conformance.suite import roles_named
from minerva_conformance.world import MemberRole, reference


def _log(line: str) -> None:
    print(line, file=sys.stderr, flush=True)  # noqa: T201


def main() -> int:
    """Take part until the world ends; returns the exit code."""
    given = os.environ
    try:
        (role,) = roles_named([given.get("MINERVA_ROLE", MemberRole.GENERATOR)])
        member = reference(role)
        return MemberProcess([member], given["MINERVA_WORLD"], given["MINERVA_CONNECT"], _log).run()
    except KeyError as missing:
        _log(f"{missing.args[0]} is not set; start this program by `minerva conformance`")
    except MinervaError as error:
        _log(str(error))
    return 1


if __name__ == "__main__":
    sys.exit(main())
