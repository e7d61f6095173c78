"""The TLS link to a robot's router: with a certificate, with none, and with wrong ones."""

import json

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("cryptography")
import zenoh

from minerva_bus.errors import MisuseError
from minerva_certificates import AuthorityFolder, Wanted
from minerva_services.bridges.ros2 import Ros2
from minerva_services.bridges.ros2.layout import Ros2Network
from minerva_services.bridges.ros2.network import Ros2Session
from minerva_services.bridges.ros_messages import messages as types
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridging import SourceError
from tests.patience import patience
from tests.runtime.running import eventually


def keys_in(folder):
    keys = AuthorityFolder(folder)
    keys.init()
    keys.issue("robot", Wanted(("operator",)))
    return keys


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    return keys_in(tmp_path_factory.mktemp("keys"))


@pytest.fixture(scope="module")
def endpoint(keys):
    """A router that requires client certificates, as rmw_zenohd can be configured."""
    own = keys.credentials("coordinator")
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": ["tls/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "adminspace/enabled": True,
        "transport/link/tls": {
            "root_ca_certificate": str(own.authority),
            "listen_private_key": str(own.key),
            "listen_certificate": str(own.certificate),
            "enable_mtls": True,
        },
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        (reply,) = session.get(f"@/{session.zid()}/router", timeout=patience(5))
        locators = json.loads(reply.ok.payload.to_string())["locators"]
        yield next(locator for locator in locators if locator.startswith("tls/127.0.0.1"))


def files(keys, name="robot"):
    own = keys.credentials(name)
    names = "authority", "certificate", "key"
    return {name: str(getattr(own, name)) for name in names}


def test_messages_go_over_a_secured_link(keys, endpoint):
    network, heard = Ros2Network(endpoint, **files(keys)), []
    first, other = Ros2Session(network, "one"), Ros2Session(network, "other")
    first.subscribe("cmd_vel", types.TWIST, heard.append)
    motors = other.publisher("cmd_vel", types.TWIST)
    eventually(lambda: motors.put(messages().twist(0.5, 0.0)) or heard, "a twist comes")
    first.close()
    other.close()


def test_a_missing_or_wrong_certificate_is_rejected(keys, endpoint, tmp_path):
    own = files(keys)
    stranger = files(keys_in(tmp_path / "others"))
    for tls in ({"authority": own["authority"]}, stranger | {"authority": own["authority"]}):
        with pytest.raises(SourceError, match="no ROS 2 network answers at tls/"):
            Ros2Session(Ros2Network(endpoint, **tls), "stranger")


@pytest.mark.parametrize(
    ("router", "options", "why"),
    [
        (
            "tls/h:1",
            {"authority": "nothing.pem"},
            "authority is 'nothing.pem'; expected a PEM file",
        ),
        ("tls/h:1", {"certificate": __file__}, "certificate and key belong together"),
        ("tcp/h:1", {"authority": __file__}, "certificates require tls/ or quic/"),
    ],
)
def test_wrong_options(router, options, why):
    with pytest.raises(MisuseError, match=why):
        Ros2(router, **options)
