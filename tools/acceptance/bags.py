"""ROS 2 bags: topics and types as in their metadata; none of the bags has readings to play."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from minerva_bus.log.recordings import RecordingError
from minerva_services.bridges.rosbag.bag import open_bag
from tools.acceptance.suite import Result, Suite, judged, whole_files

_FORMAT = re.compile(r"serialization_format: (\S+)")
_TOPIC = re.compile(r"name: (/\S+)\n\s+type: (\S+)")


def _problems(folder: Path) -> Iterator[str]:
    (bag,) = whole_files([*folder.glob("*.mcap"), *folder.glob("*.db3")])
    metadata = (folder / "metadata.yaml").read_text(encoding="utf-8")
    for path in (folder, bag):
        try:
            open_bag(path, lambda *_: None).close()
        except RecordingError as error:
            others = {name for name in _FORMAT.findall(metadata) if name != "cdr"}
            if path == folder and others:  # The metadata, but not the files, say that.
                wanted = others
            else:
                wanted = {f"{topic} ({kind})" for topic, kind in _TOPIC.findall(metadata)}
            reason = str(error).removeprefix(f"{path}: ")
            yield from (
                f"no {name}: {reason:.120}" for name in sorted(wanted) if name not in reason
            )
        else:
            yield f"{path.name}: it has a topic to play"


def _results(folder: Path) -> Iterator[Result]:
    for metadata in sorted(folder.rglob("metadata.yaml")):
        bag = metadata.parent
        yield judged(f"{bag.parent.name}/{bag.name}", _problems(bag))


ROSBAG2 = Suite(
    "rosbag2",
    "ros2/rosbag2",
    "rosbag2_tests/resources",
    "the reader of bags: topics and types, from the folder and from the file",
    _results,
)
