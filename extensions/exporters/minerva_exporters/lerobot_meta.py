"""The layout and the metadata of a data set of LeRobot, format 3.0.

Source: `lerobot.datasets` of https://github.com/huggingface/lerobot, `CODEBASE_VERSION` v3.0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_exporters.statistics import Statistics, merged
from minerva_exporters.survey import Survey

if TYPE_CHECKING:
    import pyarrow as pa

    from minerva_exporters.episode_file import EpisodeFile

VERSION: Final = "v3.0"
CHUNK: Final = 1000
"""Files in a folder."""
IMAGES: Final = "observation.images."
_FILE: Final = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_OWN: Final = ("timestamp", "frame_index", "episode_index", "index", "task_index")


@dataclass(frozen=True, slots=True)
class FeatureLayout:
    """The features of a data set; `names` has a name for each number of a vector.

    `images` are the sizes of images (height, width, channels), `seconds` the time between rows, and
    `starts` the index of the first row of each episode.
    """

    names: Mapping[str, Sequence[str]]
    images: Mapping[str, tuple[int, int, int]]
    seconds: float
    starts: Sequence[int]

    @staticmethod
    def of(plan: Survey, every: int) -> FeatureLayout:
        """The layout of episodes with a row in every n-th frame."""
        names = {
            "observation.state": plan.state.names,
            **{f"observation.{topic}": plan.vectors[topic] for topic in sorted(plan.vectors)},
            "action": plan.actions.names,
        }
        images = {IMAGES + topic: plan.images[topic] for topic in sorted(plan.images)}
        starts = [sum(each.length for each in plan.episodes[:n]) for n in range(len(plan.episodes))]
        return FeatureLayout(names, images, plan.dt * every, starts)

    @property
    def features(self) -> dict[str, dict[str, Any]]:
        """The features as in info.json."""
        vectors = {
            key: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
            for key, names in self.names.items()
        }
        sides = ["height", "width", "channels"]
        images = {
            key: {"dtype": "image", "shape": list(size), "names": sides}
            for key, size in self.images.items()
        }
        kinds = dict.fromkeys(_OWN, "int64") | {"timestamp": "float32"}
        own = {key: {"dtype": kinds[key], "shape": [1], "names": None} for key in _OWN}
        return {**vectors, **images, **own}

    def schema(self) -> pa.Schema:
        """The columns of a data file."""
        import pyarrow as pa

        columns = [
            (key, pa.float32() if len(names) == 1 else pa.list_(pa.float32(), len(names)))
            for key, names in self.names.items()
        ]
        image = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        columns += [(key, image) for key in self.images]
        kinds = dict.fromkeys(_OWN, pa.int64()) | {"timestamp": pa.float32()}
        return pa.schema([*columns, *((key, kinds[key]) for key in _OWN)])


def data_path(into: Path, number: int) -> Path:
    """The file of an episode."""
    chunk, file = divmod(number, CHUNK)
    return into / "data" / f"{_FILE.format(chunk_index=chunk, file_index=file)}.parquet"


def write_meta(
    into: Path, plan: Survey, layout: FeatureLayout, files: Sequence[EpisodeFile]
) -> None:
    """Write the metadata of complete episodes."""
    statistics = [file.statistics() for file in files]
    meta = into / "meta"
    (meta / "episodes" / "chunk-000").mkdir(parents=True)
    total = {key: merged([each[key] for each in statistics]) for key in layout.features}
    _write_json(meta / "stats.json", total)
    _write_json(meta / "info.json", _info(plan, layout))
    _write_tasks(meta / "tasks.parquet", plan.task)
    _write_episodes(meta / "episodes/chunk-000/file-000.parquet", plan, layout, statistics)


def _info(plan: Survey, layout: FeatureLayout) -> dict[str, Any]:
    rate, count = 1 / layout.seconds, len(plan.episodes)
    return {
        "codebase_version": VERSION,
        "robot_type": plan.kind.name,
        "total_episodes": count,
        "total_frames": sum(each.length for each in plan.episodes),
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        # A whole number, as readers expect, if it is one but for rounding.
        "fps": round(rate) if abs(rate - round(rate)) < 1e-6 * rate else rate,
        "splits": {"train": f"0:{count}"},
        "data_path": f"data/{_FILE}.parquet",
        "video_path": None,
        "features": layout.features,
    }


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4, allow_nan=False) + "\n", encoding="utf-8")


def _write_tasks(path: Path, task: str) -> None:
    """A table that pandas reads with the task as its index."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"task_index": [0], "task": [task]})
    types = {"task_index": "int64", "task": "unicode"}
    columns = [
        {
            "name": name, "field_name": name, "pandas_type": kind,
            "numpy_type": "object" if kind == "unicode" else kind, "metadata": None,
        }
        for name, kind in types.items()
    ]  # fmt: skip
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": columns}
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def _write_episodes(
    path: Path,
    plan: Survey,
    layout: FeatureLayout,
    statistics: Sequence[Mapping[str, Statistics]],
) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    rows: list[dict[str, Any]] = []
    for episode, values in zip(plan.episodes, statistics, strict=True):
        start, (chunk, file) = layout.starts[episode.number], divmod(episode.number, CHUNK)
        rows.append({
            "episode_index": episode.number,
            "tasks": [plan.task],
            "length": episode.length,
            "data/chunk_index": chunk,
            "data/file_index": file,
            "dataset_from_index": start,
            "dataset_to_index": start + episode.length,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
            "record": str(episode.record),
            "agent": episode.agent,
            "first_frame": episode.begin,
            **{
                f"stats/{key}/{name}": number
                for key, of_feature in values.items()
                for name, number in of_feature.items()
            },
        })  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows), path)
