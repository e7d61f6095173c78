"""A world distributed over several hosts, for tests: the hub, and hosts for members."""

import json
import shutil
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path

sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("runtime", "security")]
from running import eventually, here, write_world
from secured import AuthorityFolder, Wanted, goes_on

HERE = """
[process.steps]
service = "yard:Steps"

[process.eye]
service = "yard:Eye"
"""
THERE = {
    "east": ('agents = "yard:Walker"', {"roles": ("agent",)}),
    "west": ('agents = "yard:Walker"', {"roles": ("agent",)}),
    "water": ('service = "yard:Water"', {"roles": ("generator", "view"), "topics": ("sight",)}),
    "screen": ('service = "yard:Screen"', {"roles": ("view",)}),
}
"""Sections of the remote members, and what their certificates permit."""

STRING = " · ".join(f"AWalker#{name}<x={x}>" for x, name in enumerate("abcdefgh"))
PORT = 7447
SECURED = f'listen = "tls/0.0.0.0:{PORT}"\nkeys = "keys"\n'


class Spread:
    """A world on the host `hub`, with members on other hosts.

    `options` are additional arguments of the command that attaches a member, by its name.
    """

    def __init__(self, hub, hosts, door="hub", more=None, rate=20, options=None):
        self.hub, self.hosts, self.door = hub, hosts, door
        self.options = options or {}
        self.runs = {}
        members = HERE + "".join(
            f"[process.{name}]\n{THERE[name][0]}\nelsewhere = true\n" for name in hosts
        )
        settings = {"name": "spread", "string": STRING, "frames": 0, "rate": rate}
        self.path = write_world(hub.folder, members, bus=SECURED, **settings)
        self.keys = AuthorityFolder(hub.folder / "keys")
        self.keys.init(("hub", hub.address))
        wanted = {name: THERE[name][1] for name in hosts} | (more or {})
        for name, what in wanted.items():
            self.keys.issue(name, Wanted(**what))
        for name, host in hosts.items():
            write_world(host.folder, members, **settings)
            self.send_keys(name, host)

    def send_keys(self, name, host):
        """Copy the key and certificates of a member to its host."""
        folder = host.folder / "keys"
        folder.mkdir(mode=0o700)
        for file in ("ca.pem", f"{name}.pem", f"{name}.key"):
            shutil.copy(self.keys.folder / file, folder / file)

    def begin(self, *words):
        """Start the world and wait until all members have joined."""
        self.world = self.hub.runs_world(self.path, "--record", "run.mcap", "--json", *words)
        self.world.says("coordinator │ listens at tls/")
        for name in self.hosts:
            self.attach(name)
        self.world.runs(*self.hosts)
        return self

    def attach(self, name):
        """Start a member on its host."""
        words = ("--process", name, "--connect", f"tls/{self.door}:{PORT}", "--keys", "keys")
        self.runs[name] = self.hosts[name].starts(
            "attach", self.path.name, *words, "--world", "spread", *self.options.get(name, ())
        )

    def restarts(self, name):
        """Restart a member that has ended, as systemd does."""
        self.runs[name].ends()
        self.runs[name].__exit__()
        self.attach(name)

    def goes_on(self):
        """Wait until all members have joined and frames advance."""

        def all_here():
            for name, run in self.runs.items():
                assert run.process.poll() is None, f"{name} has ended:\n{run.text}"
            members = self.world.members()
            return all(members.get(name, {}).get("state") == "present" for name in self.hosts)

        eventually(all_here, f"everybody is back\n{self.world.text}")
        goes_on(self.world)

    @contextmanager
    def missing(self, name, outlook=""):
        """Check that the world reports the loss of a member, and the given consequence."""

        def said():
            words = f"{name} │ is gone; {outlook}" if outlook else f"{name} │ is gone"
            return sum(words in line for line in list(self.world.lines))

        before = said()
        yield
        eventually(lambda: said() > before, f"{name} is missed\n{self.world.text}")

    def ends(self):
        """Stop it; returns its summary if all processes have ended without an error."""
        with self.world.client() as asked:
            asked.ask("stop")
        summary = self.world.summary()
        assert {name: run.ends() for name, run in self.runs.items()} == dict.fromkeys(self.runs, 0)
        return summary

    def undisturbed(self, frames):
        """The summary of an undisturbed, recorded run in one process."""
        text = self.path.read_text().replace("elsewhere = true\n", "")
        alone = self.path.with_name("alone.toml")
        alone.write_text(text.replace(SECURED, ""))
        words = ("--in-process", "--name", "spread", "--frames", frames, "--json")
        done = here(self.hub.folder, "run", alone, *words, "--record", "alone.mcap", "--rate", 0)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    def is_as_if_nothing_had_happened(self):
        """Stop it and check that every frame equals that of an undisturbed run."""
        summary = self.ends()
        alone = self.undisturbed(summary["frames"])
        assert (summary["frames"], summary["digest"]) == (alone["frames"], alone["digest"])
        assert summary["frames"] > 20
        differ = here(self.hub.folder, "diff", "alone.mcap", "run.mcap")
        assert differ.returncode == 0, differ.stdout
        return True

    def close(self):
        """End all its processes, whatever their state."""
        with ExitStack() as ends:
            for run in [*([self.world] if hasattr(self, "world") else []), *self.runs.values()]:
                ends.callback(run.__exit__)


__all__ = ["HERE", "PORT", "THERE", "Spread", "eventually"]
