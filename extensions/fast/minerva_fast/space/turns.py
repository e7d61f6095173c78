"""The turns of `while` loops in machine code, counted for each activation.

Machine code that never ends cannot be interrupted: Python notices Ctrl-C between two of its own
instructions. So an activation with too many turns leaves machine code with an error, and then runs
as Python. Imports numba, so only compiled rules import this module.
"""

# numba has no types of its own.
# pyright: basic
# pyright: reportAttributeAccessIssue=false, reportOptionalCall=false, reportPrivateImportUsage=false

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final

from numba import njit
from numba.core import analysis, ir, ir_utils

from minerva_fast.space.kernels import OPTIONS
from minerva_fast.space.parts import TURNS

MOST_TURNS: Final = 1_000_000_000
"""A second or more of machine code."""
_ENDLESS: Final = "a loop of a rule has a billion turns"


@njit(**OPTIONS)
def _turn(progress: Any) -> None:
    progress[TURNS] += 1
    if progress[TURNS] > MOST_TURNS:
        raise RuntimeError(_ENDLESS)


def count_turns(function: Any, bounded: Collection[str]) -> None:
    """Count the turns in numba's representation of a function with the argument `progress`.

    Args:
        function: the representation, which is changed.
        bounded: files whose loops are known to end.

    """
    blocks = function.blocks
    arguments = [each for block in blocks.values() for each in block.find_insts(ir.Assign)]
    progress = [
        each.target
        for each in arguments
        if isinstance(each.value, ir.Arg) and each.value.name == "progress"
    ]
    if not progress:
        return
    for loop in analysis.compute_cfg_from_blocks(blocks).loops().values():
        block = blocks[loop.header]
        place = block.body[0].loc
        # A `for` loop of a rule has as many turns as its range, list or array.
        if place.filename not in bounded and not any(block.find_exprs("iternext")):
            scope = progress[0].scope
            called, nothing = (
                ir.Var(scope, ir_utils.mk_unique_var(name), place) for name in ("turn", "counted")
            )
            block.body[:0] = [
                ir.Assign(ir.Global("turn", _turn, place), called, place),
                ir.Assign(ir.Expr.call(called, progress, (), place), nothing, place),
            ]
