"""The router's configuration, checked by Zenoh, and the units, checked by systemd."""

import json
import re
import shutil
import subprocess

import pytest
import zenoh

from deploy.tests.commands import DEPLOY
from deploy.tests.deployed import UNITS
from tests.runtime.running import here


def zenoh_config():
    return zenoh.Config.from_file(str(DEPLOY / "zenoh" / "router.json5"))


def test_zenoh_reads_the_routers_configuration():
    config = zenoh_config()
    assert json.loads(config.get_json("mode")) == "router"
    tls = json.loads(config.get_json("transport/link/tls"))
    assert tls["enable_mtls"] is True
    assert json.loads(config.get_json("transport/link/protocols")) == ["tls"]
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False
    listens = json.loads(config.get_json("listen/endpoints"))
    assert all(endpoint.startswith("tls/") for endpoint in listens)


def checked_access(access):
    """Check the names in an access control section, since Zenoh ignores unknown names."""
    assert access["enabled"] is True
    assert access["default_permission"] == "deny"
    rules = {rule["id"] for rule in access["rules"]}
    subjects = {subject["id"] for subject in access["subjects"]}
    for policy in access["policies"]:
        assert set(policy["rules"]) <= rules
        assert set(policy["subjects"]) <= subjects
    return access


def test_the_router_forbids_what_it_does_not_allow():
    access = checked_access(json.loads(zenoh_config().get_json("access_control")))
    assert [rule["key_exprs"] for rule in access["rules"]] == [["minerva/**"]]


def test_the_rules_that_are_printed_are_ones_that_zenoh_takes(tmp_path):
    pytest.importorskip("cryptography")
    here(tmp_path, "keys", "init")
    here(tmp_path, "keys", "issue", "router", "--role", "router")
    here(tmp_path, "keys", "issue", "robots-2", "--role", "agent")
    printed = json.loads(here(tmp_path, "keys", "router", "router", "robot").stdout)
    rules = json.dumps(printed["access_control"])
    config = zenoh_config()
    config.insert_json5("access_control", rules)
    access = checked_access(json.loads(config.get_json("access_control")))
    assert {"coordinator", "robots-2"} <= {subject["id"] for subject in access["subjects"]}
    assert "minerva/robot/from/robots-2" in rules


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_units_are_ones_that_systemd_takes(unit, tmp_path):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not here")
    text = unit.read_text().replace("/opt/minerva/bin/minerva", "/bin/true")
    copy = tmp_path / unit.name.replace("@", "@x")
    copy.write_text(text.replace("EnvironmentFile=/etc", "EnvironmentFile=-/etc"))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(copy)], capture_output=True, text=True
    )
    ours = [line for line in done.stderr.splitlines() if unit.stem.rstrip("@") in line]
    assert (done.returncode, ours) == (0, [])


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_units_may_do_little(unit):
    settings = dict(re.findall(r"^(\w+)=(.*)$", unit.read_text(), re.M))
    assert settings["User"] == "minerva"
    assert settings["NoNewPrivileges"] == "yes"
    assert settings["ProtectSystem"] == "strict"
    assert settings["CapabilityBoundingSet"] == ""
    assert "u minerva " in (DEPLOY / "systemd" / "minerva.sysusers").read_text()
