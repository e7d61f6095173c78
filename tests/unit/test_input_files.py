"""Input files: a name may belong to a file of any kind and size."""

import os
from pathlib import Path

import pytest

from minerva_agents.robot.maps import load_map
from minerva_bus.errors import MinervaError
from minerva_bus.input_files import read_text
from minerva_bus.launch.installed import declared_options, file_text
from minerva_bus.launch.reading import read_world_file
from minerva_bus.log import scanning
from minerva_bus.log.chunks import Chunks
from minerva_bus.security.certificate_files import read_certificate
from minerva_services.options import read_password

SPARSE = 64 << 30
"""Bytes of a file that takes no space on the disk, but hours or all memory to read."""


@pytest.fixture
def sparse(tmp_path):
    path = tmp_path / "sparse.toml"
    with path.open("wb") as file:
        file.truncate(SPARSE)
    return path


READERS = {
    "a world": read_world_file,
    "the options of a world": lambda path: declared_options(str(path)),
    "a string": file_text,
    "a map": load_map,
    "a certificate": read_certificate,
    "a password": lambda path: read_password("mqtt", "", str(path)),
}


@pytest.mark.parametrize("what", READERS)
def test_a_huge_file_is_refused_by_its_size(what, sparse, monkeypatch):
    monkeypatch.setattr(Path, "read_bytes", lambda path: pytest.fail("read"))
    monkeypatch.setattr(Path, "read_text", lambda path, **_: pytest.fail("read"))
    with pytest.raises(MinervaError, match=r"68.?719.?476.?736 bytes"):
        READERS[what](sparse)


@pytest.mark.parametrize("begin", [b"", scanning.MAGIC])
def test_a_record_of_unwritten_bytes_is_not_searched_to_its_end(begin, sparse, monkeypatch):
    monkeypatch.setattr(scanning, "MAX_DAMAGE", 1 << 20)
    with sparse.open("r+b") as file:
        file.write(begin)
    with pytest.raises(MinervaError, match="no record of an MCAP file in 1,048,576 bytes"):
        Chunks(sparse)


def test_folders_and_pipes_are_named(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, reason in ((tmp_path, "a folder"), (tmp_path / "pipe", "a pipe or device")):
        with pytest.raises(OSError, match=reason):
            read_text(path)
