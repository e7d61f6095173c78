"""Assets: files beside the world and in packages, their digests, and surfaces that are none."""

import hashlib
import json
import struct
from typing import Any

import numpy as np
import pytest

from minerva_bodies.assets import MAX_BYTES
from minerva_bodies.errors import BodiesError
from minerva_bodies.meshes import check_closed, load_mesh
from minerva_bus.launch.specs import search

TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
TEXT = b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    search(tmp_path)
    # As for a command, whose own folder is searched, too.
    monkeypatch.syspath_prepend(tmp_path / "commands")
    return tmp_path


def scene(**changes):
    """A GLB file of a triangle without data, with other parts."""
    parts: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}],
    }
    text = json.dumps(parts | changes).encode()
    return struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


def glb(positions=((0, 0, 0), (1, 0, 0), (0, 2, 0))):
    trimesh = pytest.importorskip("trimesh")
    return trimesh.Trimesh(positions, [[0, 1, 2]], process=False).export(file_type="glb")


@pytest.mark.parametrize("file", ["a.obj", "b.stl", "c.STL", "pack/d.glb"])
def test_surfaces_have_their_points_in_metres(folder, file):
    (folder / "pack").mkdir()
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0)], "<f4").tobytes()
    binary = bytes(80) + struct.pack("<I", 1) + bytes(12) + points + bytes(2)
    data = {"a.obj": TETRAHEDRON, "b.stl": TEXT, "c.STL": binary, "pack/d.glb": None}[file]
    (folder / file).write_bytes(glb() if data is None else data)
    points, triangles = load_mesh(file)
    # y points up in glTF.
    far = {"c.STL": [1, 2, 0], "pack/d.glb": [1, 0, 2], "a.obj": [1, 1, 1]}.get(file, [1, 1, 0])
    assert points.max(axis=0).tolist() == far
    assert triangles.shape == (4 if file == "a.obj" else 1, 3)


def test_a_digest_in_the_name_is_checked(folder):
    (folder / "a.obj").write_bytes(TETRAHEDRON)
    digest = hashlib.sha256(TETRAHEDRON).hexdigest()
    check_closed("a.obj", load_mesh(f"a.obj#sha256={digest[:20]}"))
    for wrong in ("", "0" * 64, digest[:8]):
        with pytest.raises(BodiesError, match=f"another digest; expected #sha256={digest[:16]}"):
            load_mesh(f"a.obj#sha256={wrong}")


@pytest.mark.parametrize(
    ("file", "data", "says"),
    [
        ("none.obj", None, "no such file beside the world (FOLDER) or in an installed package"),
        ("../x.obj", None, "without .."),
        ("/etc/passwd", None, "below a folder"),
        ("", None, "below a folder"),
        ("link.obj", "link", "leads out of its folder"),
        ("huge.stl", "huge", "bytes; expected at most"),
        ("a.dae", b"", "of the type .obj, .stl, .glb"),
        ("a.glb", b"glTF", "no GLB file"),
        ("a.obj", b"v 0 0 nan\nf 1 1 1", "line 1: 'v 0 0 nan': expected three numbers"),
        ("a.obj", b"v 0 0 1\nf 1 2 3", "line 2: 'f 1 2 3': the file has 1 points"),
        ("a.obj", b"v 0 0 1\nf 1 x 3", "line 2"),
        ("a.obj", b"v 0 0 1\nf 1 1 99999999999999999999", "line 2"),
        (f"{'a' * 300}.obj", None, "File name too long"),
        ("a.obj", b"v 0 0 1\n", "0 triangles"),
        ("a.stl", b"solid", "no STL file"),
        ("a.stl", b"solid\nvertex 1 2\n", "line 2: 'vertex 1 2': expected three numbers"),
        ("a.stl", bytes(200), "no STL file"),
        ("a.glb", scene(buffers=[{"uri": "b.bin"}]), "its data are in another file, 'b.bin'"),
        ("a.glb", scene(nodes=[{"children": [0]}]), "has two parents"),
        ("a.glb", scene(accessors=[{"count": 10**9}]), "more than 1000000 triangles"),
        ("a.glb", scene(extensionsRequired=["EXT_meshopt_compression"]), "are compressed by EXT"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n", "it is flat"),
        ("open.obj", TETRAHEDRON[:-8], "it is open: 3 of 6 edges have one triangle"),
    ],
)
def test_what_is_no_mesh_is_an_error_with_its_file(folder, file, data, says):
    if data == "link":
        (folder.parent / "outside.obj").write_bytes(TETRAHEDRON)
        (folder / file).symlink_to(folder.parent / "outside.obj")
    elif data == "huge":
        with (folder / file).open("wb") as sparse:
            sparse.truncate(MAX_BYTES + 1)
    elif data is not None:
        (folder / file).write_bytes(data)
    with pytest.raises(BodiesError) as caught:
        check_closed(file, load_mesh(file))
    assert f"mesh {file!r:.99}" in str(caught.value)
    assert says.replace("FOLDER", str(folder)) in str(caught.value)
    assert len(str(caught.value).splitlines()) <= 10
