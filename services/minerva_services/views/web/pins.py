"""Texts on the page: pins with a label above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from viser import SceneApi

from minerva_bus.semantics.colors import rgb
from minerva_bus.semantics.picture import Texts
from minerva_services.views.solids import pin, upright
from minerva_services.views.web.batch import Batch
from minerva_services.views.web.labels import LabelNodes, PageLabel

MAX_LABELS = 300
_MARKED = 1.35
"""Relative size of marked pins and labels."""


class PinNodes:
    """The nodes of all texts; only the first MAX_LABELS have a label."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._pins = Batch(scene, "/pins")
        self._labels = LabelNodes(scene, "/labels")
        self._shown: tuple[list[Texts], float, Mapping[str, str]] = [], 0.0, {}

    @property
    def labels(self) -> Sequence[PageLabel]:
        """The labels shown."""
        return self._labels.shown

    def show(self, texts: list[Texts], height: float, marked: Mapping[str, str]) -> None:
        """Show exactly these, on pins of a height in metres; `marked` are larger and recoloured."""
        before, high, were = self._shown
        # Pins rarely change, and sending them costs far more than this comparison.
        if (
            (high, were) == (height, marked)
            and len(before) == len(texts)
            and all(map(_is, before, texts))
        ):
            return
        self._shown = texts, height, marked
        names = [text for batch in texts for text in batch.texts]
        places = np.array(
            [(x, y, 0.0) for batch in texts for x, y in zip(batch.x, batch.y, strict=True)]
        ).reshape(-1, 3)
        colors = [
            rgb(marked.get(text, batch.form.color)) for batch in texts for text in batch.texts
        ]
        sizes = np.array([_MARKED if text in marked else 1.0 for text in names])
        self._pins.show(
            pin(),
            places,
            upright(np.zeros(len(places))),
            np.tile(height * sizes[:, None], (1, 3)),
            np.array(colors, np.uint8).reshape(-1, 3),
        )
        self._labels.show(
            [
                PageLabel(text, (x, y, 1.12 * height * size), size)
                for text, (x, y, _), size in zip(
                    names[:MAX_LABELS], places.tolist(), sizes.tolist(), strict=False
                )
            ]
        )


def _is(first: Texts, second: Texts) -> bool:
    return first is second
