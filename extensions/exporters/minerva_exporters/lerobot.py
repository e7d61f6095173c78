"""Records as data sets of LeRobot, format 3.0: each life of an agent is an episode.

| feature                    | content                                                         |
|----------------------------|-----------------------------------------------------------------|
| observation.state          | numeric attributes at the beginning of a frame                  |
| observation.TOPIC          | the numbers of the latest reading: scan, odometry, ...          |
| observation.images.TOPIC   | the latest image                                                |
| action                     | events that the agent received in the frame, or attributes      |

Before the first reading of a sensor its numbers are 0 and its image is black.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.collector import agent_rows
from minerva_bus.collect.data_tables import needed, texts
from minerva_bus.log.record import Record
from minerva_bus.world.readings import Image
from minerva_exporters.datasets import ExportChoice, ExportProgress
from minerva_exporters.episode_file import EpisodeFile
from minerva_exporters.lerobot_meta import FeatureLayout, write_meta
from minerva_exporters.sources import FrameContents, RecordFrames, new_folder
from minerva_exporters.survey import Episode, Survey, survey
from minerva_exporters.vectors import reading_vector
from minerva_services.options import require

FORM: Final = "lerobot"
Row = dict[str, Any]


def write_dataset(
    records: Sequence[Path], into: Path, choice: ExportChoice, progress: ExportProgress
) -> Mapping[str, int]:
    """Write records as the folder of a data set; see `Exporter`."""
    needed("pyarrow", FORM)
    require(FORM, "PIL", "Pillow", FORM)
    records = list(dict.fromkeys(records))
    plan = survey(records, choice)
    total = sum(each.length for each in plan.episodes)
    layout = FeatureLayout.of(plan, choice.every)
    with new_folder(into, FORM):
        files: list[EpisodeFile] = []
        done = 0
        for path in records:
            with ExitStack() as stack:
                record = stack.enter_context(Record(path))
                writer = _RecordWriter(plan, layout, into, plan.episodes_of(path), stack)
                frames = RecordFrames(record, choice.begin, choice.end)
                for frame in frames:
                    if frame.number == frames.length:
                        break
                    writer.add(frame, is_due=not (frame.number - frames.begin) % choice.every)
                    done += len(writer.rows)
                    progress(min(done, total), total)
                writer.finish()
            files += writer.files.values()
        write_meta(into, plan, layout, sorted(files, key=lambda file: file.episode.number))
    return {"episodes": len(plan.episodes), "frames": total}


@dataclass(slots=True)
class _RecordWriter:
    """Writes the rows of a record, frame by frame.

    `latest` are the last readings by robot and topic; `rows` those that later frames may complete.
    """

    plan: Survey
    layout: FeatureLayout
    into: Path
    episodes: Mapping[str, Episode]
    stack: ExitStack
    files: dict[str, EpisodeFile] = field(default_factory=dict[str, "EpisodeFile"])
    latest: dict[tuple[str, str], Any] = field(default_factory=dict[tuple[str, str], Any])
    rows: dict[str, Row] = field(default_factory=dict[str, Row])

    def add(self, frame: FrameContents, *, is_due: bool) -> None:
        """Add a frame; if it is due, it begins a row, otherwise it may change the action."""
        for message in frame.readings:
            for reading in message.readings:
                image = isinstance(reading, Image)
                value = reading if image else reading_vector(reading)
                self.latest[reading.robot, message.topic] = value
        if is_due:
            self.finish()
            self.rows = dict(self._observed(frame))
        plan = self.plan
        done = plan.actions.of_frame(frame.events, frame.after, [*self.rows], plan.vocabulary)
        for agent, action in done.items():
            row = self.rows[agent]
            # Of the frames of a row, the last one with an action counts.
            if is_due or action.any():
                row["action"] = action

    def finish(self) -> None:
        """Write the rows that are complete."""
        for agent, row in self.rows.items():
            if agent not in self.files:
                file = EpisodeFile(self.into, self.episodes[agent], self.layout)
                self.files[agent] = file
                self.stack.callback(file.close)
            self.files[agent].add(row)
        self.rows = {}

    def _observed(self, frame: FrameContents) -> Iterator[tuple[str, Row]]:
        plan = self.plan
        kind = plan.kind
        rows = agent_rows(frame.scene, kind.name, kind.fields)
        states = plan.state.of_rows(rows)
        for agent, state in zip(texts(rows.ids()), states, strict=True):
            if agent in self.episodes:
                yield agent, {"observation.state": state, **self._sensed(agent)}

    def _sensed(self, agent: str) -> Row:
        sensed: Row = {}
        for topic, names in self.plan.vectors.items():
            zeros: NDArray[np.float64] = np.zeros(len(names))
            sensed[f"observation.{topic}"] = self.latest.get((agent, topic), zeros)
        for topic in self.plan.images:
            sensed[f"observation.images.{topic}"] = self.latest.get((agent, topic))
        return sensed
