"""Options that studies have in common, and the workers that they choose."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from minerva_bus.study.executor_pool import Workers

Limit = Annotated[float, typer.Option(help="Time limit of a run, seconds.", min=0.1)]

WorkersOption = Annotated[int, typer.Option(help="Parallel runs; 0: one per core.", min=0)]
FramesOption = Annotated[int | None, typer.Option(help="Frames per run.", min=1)]
DaskOption = Annotated[
    str,
    typer.Option(
        help="Run in the workers of a Dask cluster, each world in one process: HOST:PORT of its"
        " scheduler."
    ),
]


@dataclass(frozen=True, slots=True)
class BranchOptions:
    """Options of all studies."""

    workers: WorkersOption = 0
    in_process: Annotated[
        bool,
        typer.Option(help="Run each world in one process, without a bus: faster, same result."),
    ] = False
    dask: DaskOption = ""


@dataclass(frozen=True, slots=True)
class StudyOptions(BranchOptions):
    """Options of studies of whole runs."""

    frames: FramesOption = None


@contextmanager
def open_workers(workers: int, dask: str, limit: float) -> Generator[Workers]:
    """The workers of the options: a Dask cluster, or processes of this machine.

    Raises MisuseError if there is no cluster at this address.
    """
    from minerva_bus.study.executor_pool import Workers, dask_executor

    if not dask:
        yield Workers(workers, limit)
        return
    with dask_executor(dask) as executor:
        yield Workers(0, limit, executor)
