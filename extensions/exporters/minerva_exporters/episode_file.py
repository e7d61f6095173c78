"""The data file of one episode, written in bounded memory."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.world.readings import Image
from minerva_exporters.lerobot_meta import FeatureLayout, data_path
from minerva_exporters.statistics import Shades, Statistics, vector_statistics
from minerva_exporters.survey import Episode

_ROWS: Final = 256
"""Rows that are held before they are written."""


class EpisodeFile:
    """Writes the rows of an episode; `statistics` are known once it is closed."""

    def __init__(self, into: Path, episode: Episode, layout: FeatureLayout) -> None:
        import pyarrow.parquet as pq

        self.episode, self._layout = episode, layout
        self._path = data_path(into, episode.number)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._schema = layout.schema()
        self._file = pq.ParquetWriter(self._path, self._schema)
        self._rows: list[dict[str, Any]] = []
        self._count = 0
        self._shades = {key: Shades(size[2]) for key, size in layout.images.items()}
        self._encoded: dict[str, tuple[Image | None, bytes, NDArray[np.uint8]]] = {}

    def add(self, row: Mapping[str, Any]) -> None:
        """Add a row with a vector for each feature, and an image or None."""
        own = {
            "timestamp": self._count * self._layout.seconds,
            "frame_index": self._count,
            "episode_index": self.episode.number,
            "index": self._layout.starts[self.episode.number] + self._count,
            "task_index": 0,
        }
        vectors = {
            key: row[key].tolist() if len(names) != 1 else float(row[key][0])
            for key, names in self._layout.names.items()
        }
        images = {key: {"bytes": self._image(key, row[key]), "path": None} for key in self._shades}
        self._rows.append({**vectors, **images, **own})
        self._count += 1
        if len(self._rows) == _ROWS:
            self._flush()

    def close(self) -> None:
        """Write what is left."""
        self._flush()
        self._file.close()

    def statistics(self) -> Mapping[str, Statistics]:
        """The statistics of each feature, of the closed file."""
        import pyarrow.parquet as pq

        made: dict[str, Statistics] = {key: each.statistics() for key, each in self._shades.items()}
        for name in self._schema.names:
            if name not in made:
                column = pq.read_table(self._path, columns=[name]).column(0)
                rows = np.array(column.to_pylist(), np.float64)
                made[name] = vector_statistics(rows.reshape(len(rows), -1))
        return {key: made[key] for key in self._layout.features}

    def _flush(self) -> None:
        import pyarrow as pa

        if self._rows:
            self._file.write_table(pa.Table.from_pylist(self._rows, schema=self._schema))
            self._rows = []

    def _image(self, key: str, image: Image | None) -> bytes:
        """An image as a PNG or JPEG; a black one before the first."""
        known = self._encoded.get(key)
        if known is None or known[0] is not image:
            known = self._encoded[key] = (image, *_encoded(image, self._layout.images[key]))
        self._shades[key].add(known[2])
        return known[1]


def _encoded(image: Image | None, size: tuple[int, int, int]) -> tuple[bytes, NDArray[np.uint8]]:
    """The file of an image, and its pixels of this shape."""
    from PIL import Image as Pillow

    height, width, channels = size
    mode = "L" if channels == 1 else "RGB"
    if image is not None and image.encoding in ("jpeg", "png"):
        with Pillow.open(io.BytesIO(image.data)) as opened:
            pixels = np.asarray(opened.convert(mode), np.uint8)
        return image.data, pixels.reshape(size)
    data = bytes(height * width * channels) if image is None else image.data
    pixels = np.frombuffer(data, np.uint8).reshape(size)
    file = io.BytesIO()
    Pillow.frombytes(mode, (width, height), data).save(file, "PNG")
    return file.getvalue(), pixels
