"""A reader of the documentation who types every shell command of a page."""

import re
import shutil
import time
import tomllib
from pathlib import Path

import pytest
from pages import ROOT, SHELL, blocks, pattern, stable, transcript, written
from terminal import Terminal

TABLES = {
    page: table
    for file in ("commands.toml", "guides.toml")
    for page, table in tomllib.loads(Path(__file__).with_name(file).read_text("utf-8")).items()
}
GUIDES = ("docs/start/", "docs/tutorials/", "docs/howto/", "extensions/")
"""Pages whose blocks are one session: the reader writes the files and types on in the same folder."""
ASKS = re.compile(
    r"minerva (attach|bridge|echo|list|logs|metrics|pause|pub|rate|resume|step|stop|top)\b"
    r"|minerva graph .*--live"
)
"""Commands that need a running world, unless an option names another one."""


def means(name, line):
    """Whether an entry of a table applies to a command."""
    return line == name or (name.endswith("...") and line.startswith(name.removesuffix("...")))


class Reader:
    """Types the commands of a page from first to last."""

    def __init__(self, page, folder, island, pictures=None):
        self.table = TABLES.get(page, {})
        self.page = page
        self.pictures = pictures
        self.staying = None
        self.joined = []
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

    def follows(self):
        """Do what the page says, from its first block to its last."""
        for block in blocks(self.page):
            if block.file:
                path = self.terminal.place / block.file
                before = path.read_text(encoding="utf-8") if path.exists() else ""
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(written(block, before), encoding="utf-8")
            elif block.language in SHELL:
                for command in transcript(block):
                    began = time.monotonic()
                    self.types(command.line, command.output)
                    self.has_drawn(command.line)
                    print(f"{time.monotonic() - began:6.1f} s  {command.line[:90]}", flush=True)
                if not self.page.startswith(GUIDES):
                    self.turns_over()
        self.turns_over()

    def has_drawn(self, line):
        """Check the pictures that the page shows of a command; copy them if they are to be drawn."""
        if self.skips(line):
            return
        for words in (self.says("pictures", line) or "").split(", "):
            if words:
                file, picture = words.split(" ")
                path = self.terminal.place / file
                assert path.stat().st_size > 0, f"{line} writes no {file}"
                if self.pictures:
                    shutil.copy(path, self.pictures / picture)

    def skips(self, line):
        """Whether a command is not typed; one whose pictures are to be drawn is typed."""
        drawn = self.pictures and self.says("pictures", line)
        return self.says("skip", line) and not drawn

    def types(self, line, output=None):
        """Run one command as the page's table specifies."""
        if self.skips(line):
            return
        if self.page.startswith(GUIDES) and re.match(r"(\S+/)?pip install ", line):
            return  # Everything is installed, and the index of packages is not reachable.
        if first := self.says("first", line):
            self.ends_well(first)
        if "runs" in self.table:
            pass  # The page starts its own worlds.
        elif ASKS.match(line) and "--connect" not in line:
            self.let_a_world_run()
        elif ASKS.match(line) and self.guests is None:
            self.let_the_open_world_run()
        if line.startswith("minerva pub") and "--connect" not in line:
            # People may give orders when all have joined.
            self.terminal.until("minerva list", r"frame \d+ \((?!gathering)")
        if line.startswith("cd "):
            self.terminal.place /= line.removeprefix("cd ")
        elif line.endswith("&"):
            self.background.append(self.terminal.start(line.removesuffix("&").strip()))
        elif self.says("stays", line):
            self.open_world = line
            self.let_the_open_world_run()
        elif shown := self.says("runs", line):
            self.stops_staying()
            self.staying = self.runs_on(line, shown, pattern(output or "..."))
        elif shown := self.says("joins", line):
            self.joined.append(self.runs_on(line, shown))
        elif output and "^C\n" in output:
            self.is_interrupted(line, *map(pattern, output.split("^C\n")))
        elif shown := self.says("until", line):
            self.is_interrupted(line, shown)
        else:
            self.ends_well(line, output)
            stopped = self.staying or self.world
            if line == "minerva stop" and stopped is not None:
                stopped.ends()

    def runs_on(self, line, *shown):
        """Start a command that goes on while the reader uses another terminal."""
        running = self.terminal.start(line)
        for text in shown:
            running.shows(text)
        return running

    def stops_staying(self):
        """Press Ctrl-C in the terminals of the commands that go on."""
        for running in (*self.joined, self.staying):
            if running is not None and running.code is None:
                assert running.interrupt() in (0, 130), running.output
            assert running is None or "Traceback" not in running.output, running.output
        self.joined, self.staying = [], None

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

    def ends_well(self, line, shown=None):
        code, output = self.terminal.type(line)
        codes = self.says("codes", line) or 0
        assert code in (codes if isinstance(codes, list) else [codes]), f"{line}\n{output}"
        assert "Traceback" not in output, f"{line}\n{output}"
        if shown:
            same = re.fullmatch(pattern(shown), stable(output) + "\n")
            assert same, f"{line}\nprints\n{stable(output)}\nnot\n{stable(shown)}"

    def is_interrupted(self, line, text, end=""):
        """Wait for its output, and for frames if it is a world, then press Ctrl-C."""
        running = self.terminal.start(line)
        running.shows(text)
        if line.startswith("minerva run"):
            self.terminal.until("minerva list", r"\w")
        code = running.interrupt(b"q" if line == "minerva top" else b"\x03")
        assert code in (0, 130), f"{line} ended with {code}\n{running.output}"
        assert "Traceback" not in running.output, f"{line}\n{running.output}"
        assert re.search(end, stable(running.output) + "\n"), f"{line}\n{running.output}"

    def turns_over(self):
        """Stop the processes of a block, so that the next one starts without them."""
        self.stops_staying()
        if not self.table.get("keeps"):
            for running in self.background:
                running.interrupt()
            self.background = []
        for world in (self.world, self.guests):
            if world is not None and world.code is None:
                assert world.interrupt() in (0, 130), world.output
        self.world = self.guests = None
        self.terminal.place = self.terminal.folder


def type_page(page, folder, island, pictures=None):
    """Follow a page in the folder, and fail at the first unexpected result.

    Without a network namespace the commands run in the machine's own network, where the hosts that some
    pages name do not exist.

    Args:
        page: its path in the project.
        folder: an empty folder.
        island: the network in which the commands run.
        pictures: the folder to which the pictures of the page's table are copied; None: they are only checked.

    """
    if TABLES.get(page, {}).get("hosts") and not island.inside:
        pytest.skip("the hosts that the page names need a network namespace (unshare, nsenter)")
    reader = Reader(page, folder, island, pictures)
    try:
        reader.follows()
    finally:
        reader.terminal.close()
