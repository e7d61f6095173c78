"""Draw the pictures of guides by following their pages: python -m tools.draw_guides [PAGE ...].

Each picture is a file that a command of its page writes: the tables `pictures` in
tests/documents/guides.toml. Without arguments, all pages with pictures are followed. A page whose
outputs differ fails, as in its test.
"""

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "documents"))

from reader import TABLES, type_page  # noqa: E402  # tests/documents is no package
from terminal import Island  # noqa: E402


def main() -> None:
    pages = sys.argv[1:] or [page for page, table in TABLES.items() if "pictures" in table]
    with tempfile.TemporaryDirectory() as name:
        island = Island(Path(name))
        for number, page in enumerate(pages):
            folder = Path(name) / str(number)
            folder.mkdir()
            type_page(page, folder, island, (ROOT / page).parent)
        island.close()


if __name__ == "__main__":
    main()
