"""A JupyterLab server of its own, and a notebook in it as a reader with a browser uses it."""

import json
import os
import re
import secrets
import shutil
import subprocess
import sys
from pathlib import Path
from threading import Thread
from typing import IO

PATIENCE = 150
"""Limit of a wait in the page, seconds of an idle machine."""
SETTINGS = {
    # Otherwise cells outside the window are not in the document.
    "@jupyterlab/notebook-extension/tracker": {"windowingMode": "none"},
    "@jupyterlab/apputils-extension/notification": {"fetchNews": "false", "checkForUpdates": False},
}


class JupyterLab:
    """A server on a free port of the loopback interface, with copies of notebooks."""

    def __init__(self, folder: Path, notebooks: list[Path]):
        root = folder / "notebooks"
        root.mkdir()
        for notebook in notebooks:
            shutil.copy(notebook, root)
        for name, setting in SETTINGS.items():
            file = folder / "settings" / f"{name}.jupyterlab-settings"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(setting))
        own = {
            "IPYTHONDIR": "ipython",
            "JUPYTER_CONFIG_DIR": "config",
            "JUPYTER_DATA_DIR": "data",
            "JUPYTER_RUNTIME_DIR": "runtime",
            "JUPYTERLAB_SETTINGS_DIR": "settings",
            "JUPYTERLAB_WORKSPACES_DIR": "workspaces",
            "MINERVA_RUNTIME_DIR": "worlds",
        }
        token = secrets.token_hex(16)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--ip=127.0.0.1",
             "--port=0", f"--IdentityProvider.token={token}", f"--ServerApp.root_dir={root}"],
            env={**os.environ, **{name: str(folder / path) for name, path in own.items()}},
            stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stderr is not None
        url = announced(self.process.stderr, re.compile(r"http://127\.0\.0\.1:\d+"))
        self.address = f"{url}/lab?token={token}"
        # A full pipe would stop the server.
        Thread(target=self.process.stderr.read, daemon=True).start()

    def __enter__(self) -> "JupyterLab":
        return self

    def __exit__(self, *_: object):
        """End the server, which ends its kernels."""
        self.process.terminate()
        self.process.wait()


def announced(log: IO[str], pattern: re.Pattern[str]) -> str:
    """The first match in the lines of a server's log."""
    lines = []
    for line in log:
        lines.append(line)
        if match := pattern.search(line):
            return match[0]
    raise AssertionError("JupyterLab has ended:\n" + "".join(lines))


class OpenNotebook:
    """A notebook in a tab of JupyterLab; `page` is a page of Playwright that shows JupyterLab."""

    def __init__(self, page, name: str):
        self.page = page
        page.locator(".jp-DirListing-item", has_text=name).dblclick()
        tab = page.locator(f'.lm-TabBar-tab.lm-mod-current[title*="Path: {name}"]')
        # Panels of notebooks that were opened before stay in the document, hidden.
        self.panel = page.locator(f"#{tab.get_attribute('data-id')}")
        self._idle()

    def _idle(self):
        """Wait until the kernel is connected and has run everything."""
        # Without a kernel yet, the indicator in the notebook's toolbar is idle, too.
        self.page.locator("#jp-main-statusbar").get_by_text("(ipykernel) | Idle").wait_for()

    def run_all(self):
        """Choose Run All Cells in the menu; wait until the last cell has its number, or an error."""
        self.page.get_by_role("menuitem", name="Run", exact=True).click()
        self.page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
        last = self.panel.locator(".jp-CodeCell").last.locator(
            ".jp-InputPrompt", has_text=re.compile(r"\[\d+\]:")
        )
        last.or_(self._errors()).first.wait_for()
        self._idle()

    def cell(self, code: str):
        """The cell with this code."""
        return self.panel.locator(".jp-CodeCell").filter(
            has=self.page.locator(".jp-InputArea", has_text=code)
        )

    def run(self, code: str):
        """Run the cell with this code and wait for its next number."""
        cell = self.cell(code)
        number = cell.locator(".jp-InputPrompt").inner_text()
        cell.locator(".cm-content").click()
        self.page.keyboard.press("Control+Enter")
        cell.locator(
            ".jp-InputPrompt", has_text=re.compile(rf"\[(?!\*|{number.strip('[]:')}\])\d+\]:")
        ).wait_for()
        return cell

    def errors(self) -> list[str]:
        """Texts of outputs that report an error."""
        return self._errors().all_inner_texts()

    def _errors(self):
        # JupyterLab shows errors as it shows stderr, which may also have warnings.
        return self.outputs("application/vnd.jupyter.stderr").filter(
            has_text=re.compile(r"Error\b")
        )

    def outputs(self, kind: str):
        """Outputs of a type, such as text/html."""
        return self.panel.locator(f'.jp-OutputArea-output[data-mime-type="{kind}"]')

    def pictures(self) -> int:
        """The number of pictures in outputs; each has been loaded."""
        images = self.panel.locator(".jp-OutputArea-output img")
        for image in images.all():
            image.scroll_into_view_if_needed()
            assert image.evaluate(
                "async image => { await image.decode(); return image.naturalWidth }"
            )
        return images.count()
