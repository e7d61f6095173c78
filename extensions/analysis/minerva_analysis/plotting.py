"""Plots of runs and studies: style, axes and files. Needs the extra `plot`."""

from __future__ import annotations

import io
import threading
import warnings
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_output, ending_of, write_output
from minerva_bus.values import path_of
from minerva_bus.wording import install
from minerva_services.geometry.colors import OKABE_ITO

INK: Final = "#2f3640"
FAINT: Final = "#8a929c"
DOTS: Final = 150
"""Dots per inch."""

PAGE_DOTS: Final = 96
"""Pixels of a notebook's page per inch."""

PALE: Final = "#cfd4da"
COLORS: Final = (*OKABE_ITO, "#000000")
"""Colours of series, in this order; the same as those of groups in a view."""

LINE_STYLES: Final = ("-", "--", ":", "-.")
"""Styles of lines; the next is used when the colours repeat."""

BEST: Final = COLORS[1]
ENDINGS: Final = (".png", ".svg", ".pdf")
MAX_TEXT: Final = 80
"""Characters of a text in a plot; a column, a world or an agent may have a name without end."""

LABEL_HEIGHT: Final = 0.055
"""Least distance of the names of two lines, as a part of the axis."""

_styling: Final = threading.RLock()

STYLE: Final[Mapping[str, Any]] = {
    "font.size": 9,
    "axes.edgecolor": "#c4c9cf",
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "grid.color": "#e6e8eb",
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "svg.hashsalt": "minerva",  # Without it, ids in SVG files are random.
}
"""Settings of matplotlib."""


def check_picture(path: Path) -> None:
    """Check that a picture can be written to this file. Raises MisuseError."""
    check_ending(path, ENDINGS, "picture")
    check_output(path, "picture")
    if not path.parent.is_dir():
        raise MisuseError(f"{path}: there is no folder {path.parent}")
    _matplotlib()


def _matplotlib() -> Any:
    try:
        import matplotlib as mpl
    except ImportError:
        raise MisuseError(f"plotting needs matplotlib: {install('plot')}") from None
    return mpl


class Plot:
    """A plot, which notebooks display as a picture.

    Args:
        name: of what it shows.
        size: width and height, in inches.
        paint: draws on a figure of matplotlib.

    Raises MisuseError without matplotlib.

    """

    def __init__(self, name: str, size: tuple[float, float], paint: Callable[[Any], None]) -> None:
        _matplotlib()
        self.name = name
        self.size = size
        self._paint = paint

    def save(self, path: str | Path) -> None:
        """Write a file; its suffix names the format: .png, .svg or .pdf.

        Raises MisuseError for another format, and if the file must not be overwritten or written;
        `check_picture` reports these before a long study.
        """
        with self._figure() as figure:
            write_figure(figure, path_of("path", path))

    @contextmanager
    def _figure(self) -> Generator[Any]:
        """The painted figure; the style applies within the block."""
        mpl = _matplotlib()
        from matplotlib.figure import Figure

        # Its warnings name lines of code: that texts are wider than the plot, or numbers too large.
        # Both are of the whole process: two threads would each restore the other's.
        style = {**STYLE, "axes.prop_cycle": mpl.cycler(color=COLORS)}
        with _styling, mpl.rc_context(style), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Without pyplot, which keeps each figure in a global list and may open a window system.
            figure: Any = Figure(figsize=self.size, dpi=DOTS, layout="constrained")
            figure.get_layout_engine().set(w_pad=0.1, h_pad=0.1)
            self._paint(figure)
            yield figure

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """The picture, and its size in pixels on the page, for notebooks."""
        with self._figure() as figure:
            content = _content(figure, "png")
        width, height = (round(length * PAGE_DOTS) for length in self.size)
        return content, {"width": width, "height": height}

    def __repr__(self) -> str:
        return f"<Plot of {self.name}: save(path) writes a {', '.join(ENDINGS)} file>"


def draw(path: Path, size: tuple[float, float], paint: Callable[[Any], None]) -> None:
    """Paint on a figure of this size in inches, and save it; see `Plot`. Raises MisuseError."""
    Plot(path.stem, size, paint).save(path)


def show_grid(axis: Any, of: str = "both") -> None:
    """Show the lines of a grid behind the data; `of`: both axes, x or y."""
    axis.grid(visible=True, axis=of)
    axis.set_axisbelow(True)


def label_ends(axis: Any, ends: Sequence[tuple[float, str, str]]) -> None:
    """Write the name of each line beside the axis, moved apart where they would overlap.

    `ends`: the last value of each line, its name and its colour.
    """
    to_axes = axis.transData + axis.transAxes.inverted()
    right = axis.get_xlim()[1]
    ordered = sorted(ends, key=lambda end: end[0])
    heights = [float(to_axes.transform((right, end))[1]) for end, _, _ in ordered]
    for (_, name, color), place in zip(ordered, _spread(heights), strict=True):
        axis.annotate(
            name,
            (1, place),
            xycoords="axes fraction",
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            color=color,
            annotation_clip=False,
        )


def _spread(heights: Sequence[float]) -> list[float]:
    """Places of labels in the order of their lines, each as near to its line as the others permit.

    Labels that would overlap form a group around the mean height of their lines.
    """
    groups: list[list[float]] = []
    for height in heights:
        groups.append([height])
        while len(groups) > 1 and _top(groups[-2]) > _bottom(groups[-1]):
            groups[-2:] = [[*groups[-2], *groups[-1]]]
    return [
        _bottom(group) + (n + 0.5) * LABEL_HEIGHT for group in groups for n in range(len(group))
    ]


def _bottom(group: Sequence[float]) -> float:
    half = len(group) * LABEL_HEIGHT / 2
    return max(0.0, min(fmean(group), 1.0 - half) - half)


def _top(group: Sequence[float]) -> float:
    return _bottom(group) + len(group) * LABEL_HEIGHT


def write_figure(figure: Any, path: Path) -> None:
    """Save a matplotlib figure; the suffix of the path names the format. Raises MisuseError."""
    check_ending(path, ENDINGS, "picture")
    # `write_output` adds the mark and replaces the file only when the picture is complete.
    write_output(path, _content(figure, ending_of(path)[1:]), "picture")


def _content(figure: Any, kind: str) -> bytes:
    """A figure as a file of this format."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if len(words := text.get_text()) > MAX_TEXT:
            text.set_text(f"{words[: MAX_TEXT - 1]}…")
        # Names are not formulas, so a dollar sign is a dollar sign.
        text.set_parse_math(not words)
    content = io.BytesIO()
    figure.savefig(content, format=kind, facecolor="white")
    return content.getvalue()
