"""A robot with meshes on one machine; physics and a picture of it on another, without its files."""

import json
import shutil

import pytest
from hosts import Network, needs_hosts
from running import here

pytest.importorskip("rapier3d")
pytest.importorskip("minerva_bodies")
certificates = pytest.importorskip("minerva_certificates")

pytestmark = needs_hosts
ROBOT = """
from minerva_bodies import Box, Matter
from minerva_bodies.robot_files import TPlace
from minerva_bodies.urdf import Urdf
from minerva_bus import Agent, EventType, Metres, Primitive, Vocabulary, on, view

RING = Urdf.read("robots/ring.urdf", fixed=False)
PFloor = Primitive("PFloor", Box(3, 3, 0.5, matter=Matter(fixed=True)))
PLACE = dict.fromkeys("xyz", Metres) | dict.fromkeys("wijk", float)
ePose, eBodies = EventType("ePose", **PLACE), EventType("eBodies", visual=True)


class Ring(Agent, symbol="ARing"):
    place: tuple[float, ...] = (0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0)

    @on("ePose")
    def move(self, pose, moment):
        self.place = tuple(getattr(pose, name) for name in PLACE)

    @view("eBodies")
    def body(self, event):
        return TPlace(*self.place)(RING.links["ring"])


vocabulary = Vocabulary.of(*RING.symbols, PFloor, ePose, eBodies, Ring)
"""
URDF = """<robot name="r"><link name="ring"><collision><geometry>
<mesh filename="../parts/tetrahedron.obj"/></geometry></collision></link></robot>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
WORLD = """
[world]
vocabulary = "rings:vocabulary"
string = "TPlace<z=-0.5>(PFloor) · ARing#r"
frames = 60
seed = 1
dt = 0.02
[process.rings]
agents = "rings:Ring"
[process.files]
service = "assets"
[process.bodies]
service = "bodies"
"""
THERE = """elsewhere = true
[process.picture]
service = "solids"
draws = "eBodies"
elsewhere = true
[bus]
listen = "tls/0.0.0.0:7447"
keys = "keys"
"""


def test_physics_and_a_picture_get_the_meshes_of_a_robot(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with Network(tmp_path) as network:
        hub, lab = network.host("hub"), network.host("lab")
        files = {"rings.py": ROBOT, "robots/ring.urdf": URDF, "parts/tetrahedron.obj": OBJ}
        for path, text in (files | {"rings.toml": WORLD + THERE, "alone.toml": WORLD}).items():
            (hub.folder / path).parent.mkdir(exist_ok=True)
            (hub.folder / path).write_text(text)
        keys = certificates.AuthorityFolder(hub.folder / "keys")
        keys.init(("hub", hub.address))
        keys.issue("bodies", certificates.Wanted(("generator", "view")))
        keys.issue("picture", certificates.Wanted(("view",)))
        shutil.copytree(hub.folder / "keys", lab.folder / "keys")
        there = ("--connect", "tls/hub:7447", "--world", "rings", "--keys")
        with hub.runs_world(hub.folder / "rings.toml", "--json") as world:
            world.says("coordinator │ listens at tls/")
            drawn = ("--draws=eBodies", "--path=it.svg")
            with (
                lab.starts("attach", "bodies", *there, "keys/bodies.pem") as bodies,
                lab.starts("attach", "solids", *drawn, *there, "keys/picture.pem") as picture,
            ):
                # They end with the world, or earlier by an error.
                assert [bodies.ends(), picture.ends()] == [0, 0], bodies.text + picture.text
                summary = world.summary()
    assert len(list((tmp_path / "cache").rglob("assets/*"))) == 1
    # The floor, and the tetrahedron's faces towards the eye.
    assert (lab.folder / "it.svg").read_text().count("<polygon") > 3
    done = here(hub.folder, "run", "alone.toml", "--in-process", "--json")
    assert json.loads(done.stdout)["digest"] == summary["digest"], done.stderr
