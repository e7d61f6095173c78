"""Worlds in the kernel of a notebook: displays, clicks, errors and interruption."""

import re
from pathlib import Path

import pytest
from jupyter_client.manager import start_new_kernel

from tests.patience import eventually, patience

WORLDS = Path(__file__).parents[3] / "tests" / "api"
WIDGET = "application/vnd.jupyter.widget-view+json"
START = f"import sys; sys.path.insert(0, {str(WORLDS)!r})\nfrom balls import balls, Ball\n" + (
    "from minerva_bus import Agent, EventType, World, count, each, on, run\nlive = balls().start()\n"
)


class Kernel:
    """A kernel and what its cells display."""

    def __init__(self, folder):
        self.manager, self.client = start_new_kernel(kernel_name="python3", cwd=str(folder))

    def cell(self, code):
        """The outputs of a cell, after its end."""
        return self.outputs(self.client.execute(code))

    def outputs(self, request):
        """The outputs of a request that was sent."""
        outputs = []
        while True:
            message = self.client.get_iopub_msg(timeout=patience(60))
            if message["parent_header"].get("msg_id") != request:
                continue
            kind, content = message["msg_type"], message["content"]
            if kind == "status" and content["execution_state"] == "idle":
                return outputs
            if kind in ("execute_result", "display_data", "stream", "error"):
                outputs.append(content)

    def shown(self, code):
        """The representations of the value of a cell."""
        (output,) = self.cell(code)
        assert "data" in output, output
        return output["data"]

    def click(self, model):
        """What the browser sends for the button Step; returns when the kernel is idle again."""
        message = self.client.session.msg(
            "comm_msg", {"comm_id": model, "data": {"method": "custom", "content": {"run": 1}}}
        )
        self.client.shell_channel.send(message)
        self.outputs(message["header"]["msg_id"])


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    kernel = Kernel(tmp_path_factory.mktemp("kernel"))
    yield kernel
    kernel.client.stop_channels()
    kernel.manager.shutdown_kernel(now=True)


def test_a_live_world_follows_clicks_and_steps_of_cells(kernel):
    kernel.cell(START)
    shown = kernel.shown("live")
    assert shown["text/plain"].startswith("<Live balls; frame 0;")
    assert "data:image/svg+xml" in shown["text/html"]  # for exported notebooks
    model = shown[WIDGET]["model_id"]
    kernel.click(model)
    assert kernel.shown("live.frame")["text/plain"] == "1"
    kernel.cell("live.step(9)\nwidget = live.follower.widget")
    assert kernel.shown("widget.status")["text/plain"] == "'balls · frame 10'"
    assert kernel.shown("'frame 10' in widget.picture")["text/plain"] == "True"
    assert kernel.shown("live")[WIDGET]["model_id"] == model
    kernel.cell("live.close()")
    assert kernel.shown("(widget.status, widget.ended)")["text/plain"] == (
        "('balls · frame 10 · the world has ended', True)"
    )


def test_a_world_that_fails_or_is_forgotten_reports_it_in_its_output(kernel):
    code = """
from minerva_bus import Disc, EventType, Primitive, view
class Fly(Agent, symbol="AFly"):
    age: int = 0
    @on("eTick")
    def live(self, tick, moment):
        self.age += 1
        if self.age == 2:
            raise ValueError("too old")
    @view("ePicture")
    def picture(self, event):
        return PFly()
PFly = Primitive("PFly", Disc(0.1, "#000000"))
eTick, ePicture = EventType("eTick"), EventType("ePicture", visual=True)
flies = World("AFly#f", agents=[Fly], services=[each(eTick)], name="flies").start()
"""
    kernel.cell(START + code)
    model = kernel.shown("flies")[WIDGET]["model_id"]
    kernel.cell("widget = flies.follower.widget")
    kernel.click(model)
    assert kernel.shown("widget.problem")["text/plain"] == "''"
    kernel.click(model)
    assert "too old" in kernel.shown("widget.problem")["text/plain"]
    # Not displayed, because a notebook keeps a reference to what it has displayed.
    kernel.cell("live._repr_mimebundle_(); widget = live.follower.widget; del live")
    kernel.click(kernel.shown("widget.model_id")["text/plain"].strip("'"))
    assert "no variable refers to it" in kernel.shown("widget.problem")["text/plain"]


def test_without_anywidget_the_picture_names_the_command_that_installs_it(kernel):
    kernel.cell(START + "modules = sys.modules.pop('anywidget', None)")
    kernel.cell("sys.modules['anywidget'] = None")
    shown = kernel.shown("live")
    kernel.cell("del sys.modules['anywidget']")
    assert WIDGET not in shown
    assert "data:image/svg+xml" in shown["text/html"]
    assert re.search(r"needs anywidget: .*pip install .*minerva-bus\[notebook\]",
                     shown["text/html"])  # fmt: skip


def test_an_error_is_shown_with_the_line_of_the_cell_and_without_a_traceback(kernel):
    kernel.cell(START)
    (error,) = kernel.cell("x = 1\nlive.table()")
    (text,) = error["traceback"]
    assert text.startswith("MisuseError: nothing was collected")
    assert "live.table()" in text
    assert "/minerva_bus/" not in text


def test_an_interrupted_kernel_ends_a_run_and_keeps_its_tables(kernel, tmp_path):
    started = tmp_path / "started"
    code = f"""
from pathlib import Path
class Mark(Agent, symbol="AMark"):
    age: int = 0
    @on("eTick")
    def live(self, tick, moment):
        self.age += 1
        if self.age == 5:
            Path({str(started)!r}).touch()
eTick = EventType("eTick")
marks = World("AMark#m", agents=[Mark], services=[each(eTick)], name="marks")
"""
    kernel.cell(START + code)
    request = kernel.client.execute('run(marks, frames=0, collect={"marks": count(Mark)})')
    eventually(started.exists, "the run starts")
    kernel.manager.interrupt_kernel()
    (error,) = kernel.outputs(request)
    assert error["ename"] == "Interrupted"
    assert re.fullmatch(r"marks was interrupted after \d+ frames; .*sys.last_value.run",
                        "\n".join(error["traceback"]))  # fmt: skip
    kernel.cell("done = sys.last_value.run")
    assert kernel.shown("done.frames >= 5")["text/plain"] == "True"
    assert kernel.shown("len(done.table()) == done.frames + 1")["text/plain"] == "True"
