"""The compose file, the Dockerfile and the files that they reference."""

import json
import re
import subprocess
import sys

import pytest

from minerva_bus.launch.installed import find_world
from minerva_bus.launch.reading import read_world_file
from tests.deploy.commands import DEPLOY
from tests.deploy.deployed import COMPOSE, COMPOSED_REGIONS, DOCKERFILE, README
from tools.dependencies import IMAGE_EXTRAS, project


@pytest.mark.parametrize("name", ["compose.yaml", "regions.yaml"])
def test_compose_is_of_the_compose_specification(name):
    pytest.importorskip("check_jsonschema")
    done = subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec",
         str(DEPLOY / "docker" / name)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("file", [COMPOSE, COMPOSED_REGIONS], ids=["compose", "regions"])
def test_references_of_containers_exist(file):
    for name, container in file["services"].items():
        for network in container["networks"]:
            assert network in file["networks"], name
        for other in container.get("depends_on", ()):
            assert other in file["services"], name
        for secret in container.get("secrets", []):
            assert secret["source"] in file["secrets"], name
            assert secret["target"].endswith(secret["source"])
        for volume in container.get("volumes", []):
            source = volume.partition(":")[0]
            there = source in file["volumes"] or source.startswith(("..", "${"))
            assert there, f"{name}: {volume}"
            if source.startswith(".."):
                assert (DEPLOY / "docker" / source).exists(), source


def test_each_member_has_its_own_key_and_no_other():
    for name, container in (COMPOSED_REGIONS["services"] | COMPOSE["services"]).items():
        if "attach" in container.get("command", ()):
            own = "rabbits" if name.startswith("rabbits-") else name  # a family
            files = {secret["source"] for secret in container["secrets"]}
            # A region has the certificates of its hosts, but not their keys.
            admits = {"crl.pem", "rabbits.pem"} if name.startswith("region-") else set()
            assert files == {"ca.pem", f"{own}.pem", f"{own}.key"} | admits


def test_each_region_in_a_container_has_a_host():
    services = COMPOSED_REGIONS["services"]
    for number in range(4):
        region, host = services[f"region-{number}"], services[f"rabbits-host-{number}"]
        (listens,) = [word for word in region["command"] if word.startswith("--listen=")]
        port = listens.rpartition(":")[2]
        assert f"--connect=tls/region-{number}:{port}" in host["command"]
        assert f"--name=rabbits-host-{number}" in host["command"]
        # The region runs the processes of the world file itself, and refuses their names.
        names = {process.name for process in read_world_file(find_world("meadow")).processes}
        assert f"rabbits-host-{number}" not in names


@pytest.mark.parametrize("name", COMPOSED_REGIONS["services"] | COMPOSE["services"])
def test_containers_may_do_little(name):
    container = (COMPOSED_REGIONS["services"] | COMPOSE["services"])[name]
    assert container["cap_drop"] == ["ALL"]
    assert container["security_opt"] == ["no-new-privileges:true"]
    assert not {"privileged", "pid", "network_mode"} & container.keys()
    if container["image"].startswith("minerva-bus:"):
        assert container["read_only"] is True
    assert re.fullmatch(r"[\w./-]+:[\w.-]+", container["image"]), "an image has a tag"
    assert not container["image"].endswith(":latest")


def steps():
    text = re.sub(r"\\\n", " ", DOCKERFILE)
    return [line.split(None, 1) for line in text.splitlines() if re.match(r"[A-Z]+ ", line)]


def test_the_image_stands_on_pinned_ones():
    bases = [rest for word, rest in steps() if word == "FROM"]
    assert bases
    for base in bases:
        assert re.match(r"[\w/.-]+:\d+\.\d+\.\d+[\w.-]*(@sha256:\w+)?( AS \w+)?$", base), base


def test_the_image_runs_as_any_user():
    users = [rest for word, rest in steps() if word == "USER"]
    assert users
    assert re.fullmatch(r"[1-9]\d{3,}:[1-9]\d{3,}", users[-1]), "a number, which is not root"
    last = max(i for i, (word, _) in enumerate(steps()) if word == "USER")
    assert not [rest for word, rest in steps()[last:] if word in ("RUN", "COPY", "ADD")]


def test_the_image_keeps_nothing_of_its_making():
    for word, rest in steps():
        assert word != "ADD"
        assert word != "RUN" or not re.search(r"\bsudo\b|\bapt\b ", rest)
        if "pip install" in rest:
            assert "--no-cache-dir" in rest
        if "apt-get install" in rest:
            assert "--no-install-recommends" in rest
            assert "rm -rf /var/lib/apt/lists" in rest
        if word in ("ENTRYPOINT", "CMD"):
            assert isinstance(json.loads(rest), list), "not through a shell, which hides signals"


def test_files_copied_by_the_image_exist():
    ignore = (DEPLOY / "docker" / "Dockerfile.dockerignore").read_text().splitlines()
    copied = [rest.split() for word, rest in steps() if word == "COPY" and "--from" not in rest]
    for words in copied:
        for source in words[:-1]:
            assert (DEPLOY.parent / source).exists(), source
            assert f"!{source}" in ignore
    # All that a wheel is made of: without them the image cannot be built.
    wheel = project()["tool"]["hatch"]["build"]["targets"]["wheel"]
    sources = {source for words in copied for source in words[:-1]}
    for needed in (*wheel["packages"], *wheel["force-include"]):
        assert {needed, needed.partition("/")[0]} & sources, needed


def test_the_image_has_the_extras_that_the_page_installs():
    installed = [
        set(extras.split(",")) for extras in re.findall(r"minerva-bus\[([\w,]+)\]", README)
    ]
    assert installed
    assert all(extras >= set(IMAGE_EXTRAS) for extras in installed)
    declared = project()["project"]["optional-dependencies"]
    assert all(extras <= declared.keys() for extras in installed)
