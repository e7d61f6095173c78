"""The systemd units on a booted machine, with the page's literal commands."""

import re
import shutil
import subprocess

import pytest

from deploy.tests.deployed import README
from deploy.tests.machines.conftest import ROOT, needs, run

pytestmark = [pytest.mark.deploy, pytest.mark.timeout(900)]

TRIAL = """
[Unit]
After=basic.target dbus.service
[Service]
Type=oneshot
WorkingDirectory=/work
ExecStart=/bin/bash /trial
StandardOutput=append:/trial.log
StandardError=inherit
ExecStopPost=/bin/systemctl poweroff --force
"""
BLOCKS = re.findall(r"^```sh\n(.*?)^```", README.partition("## systemd")[2].partition("\n## ")[0],
                    re.S | re.M)  # fmt: skip
INSTALL, CERTIFICATES, WORLD, LIST, MEMBER = BLOCKS
EXPECT = """
eventually() {  # a command that comes true
    for turn in $(seq 300); do "$@" && return; sleep 0.2; done
    echo "FAILED: $*"
    journalctl --boot --no-pager | tail --lines 40
    exit 1
}
never() { if "$@"; then echo "FAILED: this should not be: $*"; exit 1; fi; }
says() { journalctl --unit "$1" --output cat | grep --quiet "$2"; }
runs_as_minerva() { test "$(stat --format %U /proc/$pid)" = minerva; }
shown() { eval "$LIST" | grep --extended-regexp --quiet "$1"; }
"""


@pytest.fixture
def machine(debian, place):
    """A function that boots a copy of the Debian, runs a script as root, returns its output."""
    needs("systemd-nspawn")
    root = place / "machine"
    run("cp", "--archive", "--reflink=auto", debian, root)
    units = root / "etc/systemd/system"
    (units / "trial.service").write_text(TRIAL)
    (units / "multi-user.target.wants").mkdir(exist_ok=True)
    (units / "multi-user.target.wants/trial.service").symlink_to(
        "/etc/systemd/system/trial.service"
    )
    (root / "etc/hosts").write_text("127.0.0.1 localhost server\n")
    source = root / "work/minerva-bus"
    for name in ("pyproject.toml", "package_metadata.py", "README.md", "LICENSE"):
        source.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source)
    for name in ("minerva_bus", "extensions", "services", "agents", "worlds", "deploy", "members"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))

    def boot(script):
        (root / "trial").write_text(f"set -e\n{script}\necho passed\n")
        subprocess.run(
            ["systemd-nspawn", "--quiet", "--boot", "--directory", root, "--register=no",
             "--machine=minerva-trial", "--keep-unit"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        return (root / "trial.log").read_text()

    yield boot
    shutil.rmtree(root)


def test_a_world_and_a_member_run_by_the_pages_commands(machine):
    """The member is a host of agents, because a lidar needs a serial line."""
    keys = (
        "PATH=/opt/minerva/bin:$PATH; minerva keys init --host server\n"
        "minerva keys issue lidar --role agent\n"
    )
    member = MEMBER.replace("MINERVA_SPEC=rplidar", "MINERVA_SPEC=robot").replace(
        "--port /dev/ttyUSB0", "--process robots"
    )
    assert member != MEMBER
    said = machine(
        f"""{EXPECT}
LIST='{LIST.strip()}'
never getent group input
{INSTALL}
getent group input
{keys}
{CERTIFICATES}
cp minerva-bus/agents/minerva_agents/robot/robot.toml /etc/minerva/yard.toml
sed --in-place 's/^until = .*/real_time = true/; /^give_up = /d' /etc/minerva/yard.toml
chown minerva:minerva /etc/minerva/yard.toml
{WORLD.replace("journalctl", "eventually says minerva-world@yard 'listens at'; journalctl")}
eventually curl --silent --fail http://127.0.0.1:9464/ready
{member}
eventually shown 'lidar +present'
systemctl kill --kill-whom=main --signal=KILL minerva-member@lidar
eventually says minerva-member@lidar 'Scheduled restart'
eventually shown 'lidar +present'
systemctl stop minerva-member@lidar
eventually shown 'lidar +left'
for unit in minerva-world@yard minerva-member@lidar; do
    systemctl start $unit
    pid=$(systemctl show --property MainPID --value $unit)
    eventually runs_as_minerva
    never nsenter --target $pid --mount --setuid 0 touch /etc/minerva/no
    nsenter --target $pid --mount touch /var/lib/minerva/yes
done
systemctl kill --kill-whom=main --signal=KILL minerva-world@yard
eventually says minerva-world@yard 'continuing from frame'
eventually curl --silent --fail http://127.0.0.1:9464/ready
systemctl stop minerva-world@yard
test "$(systemctl show --property Result --value minerva-world@yard)" = success
journalctl --boot > journal.txt
never grep --extended-regexp 'mode is different|216/GROUP' journal.txt
"""
    )
    assert said.endswith("\npassed\n"), said[-3000:]
