"""The compose file, the Dockerfile and the files that they reference."""

import json
import re
import subprocess
import sys

import pytest

from deploy.tests.commands import DEPLOY
from deploy.tests.deployed import COMPOSE, DOCKERFILE, README
from tools.dependencies import IMAGE_EXTRAS, project


def test_compose_is_of_the_compose_specification():
    pytest.importorskip("check_jsonschema")
    done = subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec",
         str(DEPLOY / "docker" / "compose.yaml")],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_references_of_containers_exist():
    for name, container in COMPOSE["services"].items():
        for network in container["networks"]:
            assert network in COMPOSE["networks"], name
        for other in container.get("depends_on", ()):
            assert other in COMPOSE["services"], name
        for secret in container.get("secrets", []):
            assert secret["source"] in COMPOSE["secrets"], name
            assert secret["target"].endswith(secret["source"])
        for volume in container.get("volumes", []):
            source = volume.partition(":")[0]
            there = source in COMPOSE["volumes"] or source.startswith(("..", "${"))
            assert there, f"{name}: {volume}"
            if source.startswith(".."):
                assert (DEPLOY / "docker" / source).exists(), source


def test_each_member_has_its_own_key_and_no_other():
    for name, container in COMPOSE["services"].items():
        if "attach" in container.get("command", ()):
            files = {secret["source"] for secret in container["secrets"]}
            assert files == {"ca.pem", f"{name}.pem", f"{name}.key"}


@pytest.mark.parametrize("name", COMPOSE["services"])
def test_containers_may_do_little(name):
    container = COMPOSE["services"][name]
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
