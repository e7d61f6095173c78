"""Runs, pictures, films and live worlds as HTML."""

import json
import re
from base64 import b64decode
from itertools import pairwise

from minerva_bus import run
from minerva_notebook.displays import MAX_PICTURES
from tests.api.balls import balls
from tests.api.frogs import pond


def images(html):
    """The SVG documents of the images of an element of HTML."""
    return [
        b64decode(data).decode()
        for data in re.findall(r"data:image/svg\+xml;base64,([^\"]+)", html)
    ]


def film_of(html):
    """The SVG documents of a film, as its script makes them, by frame."""
    film = json.loads(re.search(r"const film = (.*);", html)[1])
    return {
        frame: "\n".join(film["lines"][line] for line in lines)
        for frame, lines in zip(film["frames"], film["pictures"], strict=True)
    }


def shown(value):
    """The HTML that a notebook displays for a value."""
    return value._repr_mimebundle_()["text/html"]


def test_a_run_is_displayed_by_its_last_picture_or_its_film():
    done = run(balls(), frames=7)
    assert images(shown(done)) == images(shown(done.picture())) == [done.picture().svg]
    filmed = run(balls(), frames=7, film=3)
    expected = {p.frame: p.svg.rstrip("\n") for p in filmed.film().pictures}
    assert film_of(shown(filmed)) == film_of(shown(filmed.film())) == expected


def test_a_run_without_forms_is_displayed_without_a_picture():
    html = shown(run(pond(), frames=2))
    assert "no primitive has a form" in html
    assert "2 frames" in html


def test_outside_of_a_notebook_a_live_world_has_no_buttons():
    with balls().start() as live:
        assert live._repr_mimebundle_() == {"text/plain": repr(live)}


def test_a_long_film_shows_a_part_evenly_with_both_ends():
    film = run(balls(), frames=MAX_PICTURES * 3, film=1).film()
    frames = list(film_of(shown(film)))
    assert len(frames) == MAX_PICTURES
    assert (frames[0], frames[-1]) == (0, MAX_PICTURES * 3)
    steps = {after - before for before, after in pairwise(frames)}
    assert steps <= {3, 4}


def test_a_film_is_a_page_that_needs_no_other_file(tmp_path):
    path = tmp_path / "balls.html"
    run(balls(), frames=7, film=3).film().save(path)
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"?https?:", page)
    assert len(film_of(page)) == 4
