"""Runs, pictures and films as HTML that needs no network and no kernel."""

from __future__ import annotations

import base64
import html
import json
import secrets
from collections.abc import Sequence
from importlib import resources
from string import Template
from typing import Any, Final

from minerva_bus.api.live import Live
from minerva_bus.api.pictures import Film, Still
from minerva_bus.api.running import Run
from minerva_bus.errors import MinervaError, MisuseError
from minerva_notebook.live_widget import LiveDisplay, in_notebook

MAX_PICTURES: Final = 300
"""Pictures of the page; of a longer film it has a part, evenly distributed."""


def display(shown: object) -> dict[str, Any]:
    """What a notebook displays in place of a value, by type; empty for its text alone."""
    match shown:
        case Still():
            return {"text/html": image_of(shown)}
        case Film():
            return {"text/html": page_of(shown)}
        case Run():
            return {"text/html": _figure(_picture_of(shown), shown.facts)}
        case Live() if in_notebook():
            return _with_buttons(shown)
        case _:
            return {}


def image_of(picture: Still) -> str:
    """A picture as an element of HTML."""
    # As an image, because notebooks remove inline SVG from outputs that they do not trust, and
    # because their style sheets would apply to it.
    data = base64.b64encode(picture.svg.encode()).decode("ascii")
    about = html.escape(f"{picture.world}, frame {picture.frame}")
    return (
        f'<img alt="{about}" src="data:image/svg+xml;base64,{data}"'
        ' style="max-width: 100%; max-height: 30em">'
    )


def page_of(film: Film) -> str:
    """An element of HTML: picture, slider and a button that plays the film."""
    count = min(len(film), MAX_PICTURES)
    step = (len(film) - 1) / max(count - 1, 1)
    shown = [film.pictures[round(number * step)] for number in range(count)]
    # Pictures share most of their lines, such as those of a map.
    lines: dict[str, int] = {}
    documents = [
        [lines.setdefault(line, len(lines)) for line in picture.svg.splitlines()]
        for picture in shown
    ]
    data = {
        "frames": [picture.frame for picture in shown],
        "pictures": documents,
        "lines": [*lines],
    }
    template = resources.files("minerva_notebook").joinpath("film.html").read_text(encoding="utf-8")
    return Template(template).substitute(
        # Several outputs of a notebook are parts of one page.
        id=f"minerva-film-{secrets.token_hex(4)}",
        image=image_of(shown[0]),
        last=count - 1,
        # "</" would end the script.
        film=json.dumps(data).replace("</", "<\\/"),
    )


def _picture_of(done: Run) -> str:
    """The film of a run, or a picture of its last string, or why there is none."""
    try:
        return page_of(done.film()) if done.kept else image_of(done.picture())
    except MinervaError as error:
        return _unpictured(error)


def _with_buttons(live: Live) -> dict[str, Any]:
    """Buttons, and a picture that follows the frames."""
    facts, controls = live.facts, dict[str, Any]()
    try:
        shown = image_of(live.picture())
    except MinervaError as error:
        shown = _unpictured(error)
    else:
        try:
            if not isinstance(live.follower, LiveDisplay):
                live.follower = LiveDisplay(live)
            controls = live.follower.mimebundle()
        except MisuseError as error:
            facts.append(f"buttons: {error}")
    # The picture is for exported notebooks, which have no kernel.
    return {**controls, "text/html": _figure(shown, facts)}


def _figure(shown: str, facts: Sequence[str]) -> str:
    """An element of HTML with a line of facts below it."""
    line = " · ".join(html.escape(fact) for fact in facts if fact)
    return f'<div>{shown}<div style="font-size: 90%; opacity: .8">{line}</div></div>'


def _unpictured(error: MinervaError) -> str:
    """The reason why there is no picture, as an element of HTML."""
    return f"<pre>{html.escape(str(error))}</pre>"
