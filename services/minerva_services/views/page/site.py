"""The files that a page's server hands out: the page, the package for members, and modules."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.errors import MisuseError

_STATIC: Final = Path(__file__).parent / "static"
_TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
}
_PACKAGE: Final = "minerva"
_MODULES: Final = "modules"
_INLINE: Final = re.compile(rb'<script type="importmap">(.*?)</script>', re.S)


@dataclass(frozen=True, slots=True)
class SiteFile:
    """A file with its media type."""

    media_type: str
    content: bytes


def package_folder() -> Path:
    """The sources of members/javascript: within the installed package, or in the repository.

    Raises MisuseError if neither is there.
    """
    installed = Path(__file__).parent / "javascript"
    repository = Path(__file__).parents[4] / "members" / "javascript" / "src"
    folder = next((path for path in (installed, repository) if (path / "index.js").is_file()), None)
    if folder is None:
        raise MisuseError(f"page: the package for members is missing in {installed}; install again")
    return folder


class PageSite:
    """Finds files by the path of a request; it reads no others than those of three folders.

    `module`, if not None, is a file of the world's, which may import the JavaScript files beside
    it; `self.module` is the path under which pages find it, or "".
    """

    def __init__(self, module: Path | None) -> None:
        self._folders = {_PACKAGE: package_folder()}
        self.module = ""
        if module is not None:
            self._folders[_MODULES] = module.parent
            self.module = f"/{_MODULES}/{module.name}"
        html = (_STATIC / "page.html").read_bytes()
        scripts = _INLINE.findall(html)
        hashes = [f"'sha256-{_digest(script)}'" for script in scripts]
        # Everything is from this server; inline is only the map of module names.
        self.policy = "; ".join(
            [
                "default-src 'self'",
                f"script-src 'self' {' '.join(hashes)}",
                "img-src 'self' data:",
                "frame-ancestors 'none'",
                "base-uri 'none'",
            ]
        )

    def file(self, path: str) -> SiteFile | None:
        """The file at the path of a request; None if there is none."""
        folder, slash, name = path.removeprefix("/").rpartition("/")
        if not slash:
            place, allowed = _STATIC, tuple(_TYPES)
            name = name or "page.html"
        elif folder in self._folders:
            place, allowed = self._folders[folder], (".js", ".mjs")
        else:
            return None
        # A name is a single part, so that no path leads out of a folder.
        if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name) or not name.endswith(allowed):
            return None
        file = place / name
        if not file.is_file():
            return None
        return SiteFile(_TYPES[file.suffix], file.read_bytes())


def _digest(script: bytes) -> str:
    return base64.b64encode(hashlib.sha256(script).digest()).decode()
