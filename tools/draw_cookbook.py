"""Write docs/cookbook.md, and draw its pictures: python -m tools.draw_cookbook [RECIPE ...].

The page has an introduction and the programs of examples/cookbook, which run in a temporary
folder. Pictures that they write as .svg become .png here. With --page, only the page is written.
"""

import runpy
import sys
import tempfile
from contextlib import chdir
from io import BytesIO
from pathlib import Path

from PIL import Image

from minerva_services.views.svg.rendering import png

ROOT = Path(__file__).parents[1]
PROGRAMS = ROOT / "examples" / "cookbook"
PICTURES = ROOT / "docs" / "cookbook"
PAGE = ROOT / "docs" / "cookbook.md"
RECIPES = (
    *("grid", "torus", "network", "field", "warmth", "image", "gis", "colour", "size", "births"),
    *("batch", "species", "chance", "orders", "collect", "sweep", "parallel", "film", "load"),
    *("save", "resume", "forest"),
)


def page() -> str:
    """The text of the page: its introduction as it is, and all programs."""
    introduction, _, _ = PAGE.read_text(encoding="utf-8").partition("\n## ")
    parts = [introduction]
    for recipe in RECIPES:
        text = (PROGRAMS / f"{recipe}.py").read_text(encoding="utf-8")
        title, _, about = text.partition("\n")[0].strip('"').partition(": ")
        shown = sorted(PICTURES.glob(f"{recipe}.png")) + sorted(PICTURES.glob(f"{recipe}-*.png"))
        about = about[0].upper() + about[1:]
        seen = {path: path.stem.removeprefix(recipe).strip("-") for path in shown}
        texts = {path: f"{title}: its {part}" if part else about for path, part in seen.items()}
        pictures = [f"![{texts[path].rstrip('.')}](cookbook/{path.name})" for path in shown]
        program = f"`{recipe}.py`:\n\n```python\n{text}```"
        parts.append("\n\n".join([f"## {title}", about, program, *pictures]))
    return "\n\n".join(part.strip() for part in parts) + "\n"


def draw(recipe: str) -> None:
    """Run a program, and keep its pictures."""
    with tempfile.TemporaryDirectory() as name, chdir(name):
        runpy.run_path(str(PROGRAMS / f"{recipe}.py"))
        for path in sorted(Path().glob(f"{recipe}*.[ps][nv]g")):
            data = path.read_bytes()
            picture = Image.open(BytesIO(png(data.decode()) if path.suffix == ".svg" else data))
            # A palette takes a third of the room; its colours are adjusted to those that are used.
            picture = picture.convert("RGB").quantize(256, kmeans=3)
            picture.save(PICTURES / f"{path.stem}.png", optimize=True)


if __name__ == "__main__":
    words = sys.argv[1:]
    PICTURES.mkdir(exist_ok=True)
    for recipe in [] if words == ["--page"] else words or RECIPES:
        draw(recipe)
    PAGE.write_text(page(), encoding="utf-8")
