"""A reader of the documentation who types every shell command of a page."""

import re
import shutil
import time
import tomllib
from pathlib import Path

import pytest
from pages import PAGES, ROOT, blocks, shell
from terminal import Terminal

TABLES = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
GROUPS = {"studies": "docs/studies.md", "docs": "docs/", "worlds": "worlds/", "others": ""}
"""Path prefixes of the pages in each group; one test file per group, as pages are slow."""
ASKS = re.compile(
    r"minerva (attach|bridge|echo|list|logs|metrics|pause|pub|rate|resume|step|stop|top)\b"
)
"""Commands that need a running world, unless an option names another one."""


def means(name, line):
    """Whether an entry of a table applies to a command."""
    return line == name or (name.endswith("...") and line.startswith(name.removesuffix("...")))


class Reader:
    """Types the commands of a page from first to last."""

    def __init__(self, page, folder, island):
        self.table = TABLES.get(page, {})
        self.terminal = Terminal(folder, island)
        self.world = None
        self.background = []
        self.open_world = ""
        self.guests = None
        if "folder" in self.table:
            ignore = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / self.table["folder"], folder, dirs_exist_ok=True, ignore=ignore)
        for name, block in self.table.get("files", {}).items():
            language, number = block.split()
            (folder / name).write_text(blocks(page, language)[int(number)].text, encoding="utf-8")
        for line in self.table.get("before", ()):
            self.ends_well(line.replace("{root}", str(ROOT)).replace("{here}", str(folder)))

    def says(self, key, line):
        """The entry of the page's table for a command, or None."""
        return next(
            (text for name, text in self.table.get(key, {}).items() if means(name, line)), None
        )

    def types(self, line):
        """Run one command as the page's table specifies."""
        if self.says("skip", line):
            return
        if first := self.says("first", line):
            self.ends_well(first)
        if ASKS.match(line) and "--connect" not in line:
            self.let_a_world_run()
        elif ASKS.match(line) and self.guests is None:
            self.let_the_open_world_run()
        if line.startswith("cd "):
            self.terminal.place /= line.removeprefix("cd ")
        elif line.endswith("&"):
            self.background.append(self.terminal.start(line.removesuffix("&").strip()))
        elif self.says("stays", line):
            self.open_world = line
            self.let_the_open_world_run()
        elif shown := self.says("until", line):
            self.is_interrupted(line, shown)
        else:
            self.ends_well(line)

    def let_a_world_run(self):
        """Start the world of the other terminal unless it runs."""
        if self.world is None or self.world.code is not None:
            self.world = self.terminal.start(self.table["world"])
            self.world.shows("bus at")
            self.terminal.until("minerva list", r"\w")

    def let_the_open_world_run(self):
        """Start the world that remote members join; it reads the keys that exist at that time."""
        self.guests = self.terminal.start(self.open_world)
        self.guests.shows(self.says("stays", self.open_world))

    def ends_well(self, line):
        code, output = self.terminal.type(line)
        assert code == (self.says("codes", line) or 0), f"{line}\n{output}"
        assert "Traceback" not in output, f"{line}\n{output}"

    def is_interrupted(self, line, text):
        """Wait for its output, and for frames if it is a world, then press Ctrl-C."""
        running = self.terminal.start(line)
        running.shows(text)
        if line.startswith("minerva run"):
            self.terminal.until("minerva list", r"\w")
        code = running.interrupt(b"q" if line == "minerva top" else b"\x03")
        assert code in (0, 130), f"{line} ended with {code}\n{running.output}"
        assert "Traceback" not in running.output, f"{line}\n{running.output}"

    def turns_over(self):
        """Stop the processes of a block, so that the next one starts without them."""
        if not self.table.get("keeps"):
            for running in self.background:
                running.interrupt()
            self.background = []
        for world in (self.world, self.guests):
            if world is not None and world.code is None:
                assert world.interrupt() in (0, 130), world.output
        self.world = self.guests = None
        self.terminal.place = self.terminal.folder


def of(group):
    """The pages of a group with shell commands; the first matching group gets a page."""
    fits = {
        page: next(name for name, start in GROUPS.items() if page.startswith(start))
        for page in PAGES
    }
    return [page for page in PAGES if shell(page) and fits[page] == group]


def type_page(page, folder, island):
    """Type each command of a page in the folder, and fail at the first unexpected result.

    Without a network namespace the commands run in the machine's own network, where the hosts that some
    pages name do not exist.
    """
    if TABLES.get(page, {}).get("hosts") and not island.inside:
        pytest.skip("the hosts that the page names need a network namespace (unshare, nsenter)")
    reader = Reader(page, folder, island)
    try:
        for block in shell(page):
            for line in block:
                began = time.monotonic()
                reader.types(line)
                print(f"{time.monotonic() - began:6.1f} s  {line[:90]}", flush=True)
            reader.turns_over()
    finally:
        reader.terminal.close()
