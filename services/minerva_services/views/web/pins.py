"""Texts on the page: pins with a label above."""

from __future__ import annotations

import numpy as np
from viser import LabelHandle, SceneApi

from minerva_bus.semantics.picture import Texts, rgb
from minerva_services.views.web.batch import Batch, upright
from minerva_services.views.web.solids import pin

MAX_LABELS = 300


class PinNodes:
    """The nodes of all texts; only the first MAX_LABELS have a label."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._pins = Batch(scene, "/pins")
        self._labels: list[LabelHandle] = []
        self._shown: tuple[list[Texts], float] = [], 0.0

    def show(self, texts: list[Texts], height: float) -> None:
        """Show exactly these, on pins of a height in metres."""
        before, high = self._shown
        # Pins rarely change, and sending them costs far more than this comparison.
        if high == height and len(before) == len(texts) and all(map(_is, before, texts)):
            return
        self._shown = texts, height
        places = np.array(
            [(x, y, 0.0) for batch in texts for x, y in zip(batch.x, batch.y, strict=True)]
        ).reshape(-1, 3)
        colors = [rgb(batch.form.color) for batch in texts for _ in batch.texts]
        self._pins.show(
            pin(),
            places,
            upright(np.zeros(len(places))),
            np.full((len(places), 3), height),
            np.array(colors, np.uint8).reshape(-1, 3),
        )
        self._label([text for batch in texts for text in batch.texts][:MAX_LABELS], places, height)

    def _label(self, texts: list[str], places: np.ndarray, height: float) -> None:
        while len(self._labels) > len(texts):
            self._labels.pop().remove()
        for number, (text, (x, y, _)) in enumerate(zip(texts, places.tolist(), strict=False)):
            place = (x, y, 1.12 * height)
            if number == len(self._labels):
                self._labels.append(
                    self._scene.add_label(
                        f"/labels/{number}", text, position=place, anchor="bottom-center"
                    )
                )
            self._labels[number].text = text
            self._labels[number].position = place


def _is(first: Texts, second: Texts) -> bool:
    return first is second
