"""The result of a run, also of one that was interrupted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minerva_bus.api.pictures import Displayed, Film, Still
from minerva_bus.api.world_views import PICTURE, WIDTH, Visual, WorldViews
from minerva_bus.arguments import text
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.scene import Scene
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
from minerva_bus.wording import counted

if TYPE_CHECKING:
    from minerva_bus.api.world import World

FRAMES = "frames"
SHOWN_DIGITS = 8


@dataclass(frozen=True, repr=False)
class Run(Displayed):
    """A run that has ended. Notebooks display its film, or a picture of its last string.

    Attributes:
        scene: the last string.
        frames: the number of frames; `digest` is that of the string after them, in hexadecimal.
        events: the number of events, by type.
        ended: why it ended; `reached`: whether every agent has sent the event `until`.
        figures: metrics that its members reported, by name.
        seconds: from the end of the first frame to the end of the last one, wall time.
        tables: collected data, by the names of tables; see `table`.
        into: the file for collected data; "": they are in `tables`.
        views: draws strings of its world.
        kept: numbers of frames, and the strings with which they begin, for `film`.
        record: the file in which it was recorded; "": none.
        world: what ran, with its code; None: it is not known.
        settings: with which it ran.

    """

    scene: Scene
    frames: int
    digest: str
    views: WorldViews
    events: Mapping[str, int]
    ended: str = ""
    reached: bool = False
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    seconds: float = 0.0
    tables: Mapping[str, DataTable] = field(default_factory=dict[str, DataTable])
    into: str = ""
    kept: tuple[tuple[int, Scene], ...] = ()
    record: str = ""
    world: World | None = None
    settings: Overrides = AS_WRITTEN

    def table(self, name: str = "") -> DataTable:
        """A table of collected data.

        Args:
            name: of the table (`frames`, an agent kind, an event type) or of an entry of `collect`;
                "": that with a row for each frame, or the only one.

        Raises MisuseError if nothing was collected, or if no table has this name.

        Example:
            `run.table().to_pandas()`, `run.table("APerson")["x"]`

        """
        return pick_table(self.tables, name, self.into)

    def plot(self, path: str | Path, *series: str, x: str = "") -> None:
        """Save a plot of the table with a row for each frame, as `minerva plot` does.

        Args:
            path: of the picture, .png, .svg or .pdf.
            series: columns, or names of histograms; none: all.
            x: the column along the axis; "": time.

        Raises MisuseError, also without matplotlib.

        """
        self.table().plot(*series, x=x).save(path)

    def picture(self, event: Visual = PICTURE, width: int = WIDTH) -> Still:
        """A picture of the last string, drawn by the view `svg`.

        Args:
            event: the visual event type to draw.
            width: in pixels.

        Raises MisuseError if the world has no such view, or no primitive with a form.

        """
        return self.views.picture(self.scene, self.frames, event, width)

    def film(self, event: Visual = PICTURE, width: int = WIDTH) -> Film:
        """A film of `run(..., film=every)`; see `picture`.

        Raises MisuseError also if no strings were kept.
        """
        if not self.kept:
            raise MisuseError("no film was kept: run(world, film=10) keeps every 10th frame")
        return self.views.film(self.kept, event, width)

    @property
    def facts(self) -> list[str]:
        """What notebooks and terminals show of it."""
        tables = f"tables: {', '.join(self.tables)}" if self.tables else ""
        into = f"data in {self.into}" if self.into else ""
        frames = f"{counted(self.frames, 'frame')} in {self.seconds:.1f} s"
        digest = f"digest {self.digest[:SHOWN_DIGITS]}…"
        return [fact for fact in (frames, self.ended, digest, tables, into) if fact]

    def __repr__(self) -> str:
        return f"<Run of {self.views.name}: {'; '.join(self.facts)}>"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or the interruption of a notebook's kernel, has ended a run.

    `run` is the run up to its last complete frame, with its tables.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        super().__init__(
            f"{run.views.name} was interrupted after {counted(run.frames, 'frame')};"
            " its result is the attribute `run` of this exception: sys.last_value.run"
        )

    def _render_traceback_(self) -> list[str]:
        """The lines that a notebook shows: an interruption is not an error in its code."""
        return [str(self)]


def pick_table(tables: Mapping[str, DataTable], name: str, into: str = "") -> DataTable:
    """One of some tables; see `Run.table`."""
    if not tables:
        raise MisuseError(
            f"the collected data are in the file {into}"
            if into
            else 'nothing was collected: run(world, collect={"people": count(Person)})'
        )
    if not name and (FRAMES in tables or len(tables) == 1):
        return tables[FRAMES if FRAMES in tables else next(iter(tables))]
    if text("table", name) in tables:
        return tables[name]
    # An entry of `collect` is a column of some table.
    for table in tables.values():
        if name in table.columns and name not in ("frame", "time", "id"):
            return table
    names = ", ".join(tables)
    raise MisuseError(
        f"there is no table {name!r}{nearest(name, [*tables], f'there are {names}')}"
        if name
        else f"which table: {names}"
    )
