"""Documents and folders of the repository outside `docs/` as parts of the site.

Sources are read in two places: as files in a repository browser, and as pages of the site. Links
are written for the first place, relative to their file. In the site

- a page whose text is `{document} PATH` shows a Markdown file, and its links work; the sentence in
  the block, a link to the file, is for the repository browser; the page of an extension that is
  left out says so, and links to it are plain text;
- a link to such a file leads to its page;
- a link to a folder leads to the page of its README, or, if it has no page, to an archive of it.

All other files of the repository are downloads, which MyST provides.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, cast

from docutils import nodes
from rendering import MarkdownDirective
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.osutil import relative_uri

EXTENSIONS = Path(__file__).resolve().parents[2] / "extensions"
ARCHIVES = "_downloads/folders"
STAMP = (1980, 1, 1, 0, 0, 0)
"""Time of all files in an archive, so that the same files give the same archive."""


class Document(MarkdownDirective):
    """A Markdown file of the repository as a page; `include` would keep its links as they are."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        relative, name = self.env.relfn2path(self.arguments[0])
        path = Path(name)
        if extension := left_out(path):
            return self.rendered(f"# {path.stem}\n\nThis copy has no extension `{extension}`.\n")
        self.env.note_dependency(relative)
        self.env.note_included(name)
        return self.rendered(path.read_text(encoding="utf-8"), path.parent)


def left_out(path: Path) -> str | None:
    """The extension of a path below `extensions/` whose folder does not exist, or None."""
    if EXTENSIONS not in path.parents:
        return None
    name = path.relative_to(EXTENSIONS).parts[0]
    return None if (EXTENSIONS / name).exists() else name


def page_of(env: BuildEnvironment, path: Path) -> str | None:
    """The page that includes a document; `path`: the document without its suffix."""
    document = env.path2doc(f"{path}.md")
    pages = sorted(page for page, included in env.included.items() if document in included)
    return pages[0] if pages else None


def archive(folder: Path, root: Path, out: Path) -> str:
    """Write a folder as `out/NAME.zip` and return NAME.zip; its paths begin at `root`."""
    name = "-".join(folder.relative_to(root).parts) + ".zip"
    out.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(out / name, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                entry = zipfile.ZipInfo(str(path.relative_to(root)), STAMP)
                file.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)
    return name


class RepositoryLinks(SphinxPostTransform):
    """Resolves links to documents and folders outside `docs/`, before MyST does the others."""

    default_priority = 8  # MyST resolves its links at 9.

    def run(self, **kwargs: Any) -> None:
        for node in list(self.document.findall(addnodes.pending_xref)):
            if node["reftype"] == "myst" and node["reftarget"] not in self.env.all_docs:
                self.resolve(node)

    def resolve(self, node: addnodes.pending_xref) -> None:
        """Make one link right for the site; MyST reports links that remain unresolved."""
        target = Path(self.env.srcdir, Path(node["refdoc"]).parent, node["reftarget"]).resolve()
        if left_out(target):
            node.replace_self([cast(nodes.Node, child.deepcopy()) for child in node.children])
            return
        folder = node["refdomain"] is None and target.is_dir()
        page = page_of(self.env, target / "README" if folder else target)
        if page is not None:
            node["refdomain"], node["reftarget"] = "doc", page
            node.setdefault("reftargetid", None)
        elif folder:
            node.replace_self(self.download(node, target))

    def download(self, node: addnodes.pending_xref, folder: Path) -> nodes.reference:
        """A link to an archive of a folder."""
        name = archive(folder, Path(self.env.srcdir).parent, Path(self.app.outdir, ARCHIVES))
        here = self.app.builder.get_target_uri(node["refdoc"])
        uri = relative_uri(here, f"{ARCHIVES}/{name}")
        link = nodes.reference("", "", refuri=uri, internal=True, classes=["download"])
        link += [cast(nodes.Node, child.deepcopy()) for child in node.children]
        return link


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the extension to a build."""
    app.add_directive("document", Document)
    app.add_post_transform(RepositoryLinks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
