"""docs/python.md: its blocks run in order, and the first one is examples/sir/sir.py."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)
EXAMPLE = (ROOT / "examples" / "sir" / "sir.py").read_text(encoding="utf-8")
TUTORIAL = (ROOT / "docs" / "tutorials" / "2-epidemic.md").read_text(encoding="utf-8")


def test_the_first_block_is_the_example_with_a_curve_in_thirty_lines():
    assert BLOCKS[0] == EXAMPLE
    assert f"```python\n{EXAMPLE}```" in TUTORIAL
    code = [line for line in EXAMPLE.splitlines() if line.strip() and not line.startswith('"""')]
    assert len(code) <= 30


def test_the_blocks_run_in_their_order(tmp_path):
    (tmp_path / "sir.py").write_text(EXAMPLE, encoding="utf-8")
    program = tmp_path / "program.py"
    program.write_text("\n".join(BLOCKS[1:]), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert "a world with 2 processes" in done.stdout


def test_the_example_prints_its_curve():
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "sir" / "sir.py"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout.split()[:4] == ["frame", "time", "sick", "immune"]


def test_the_table_of_a_world_file_is_what_it_says():
    import tomllib

    from minerva_bus.collect.plans import read_expression

    (text,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.M | re.S)
    table = tomllib.loads(text)["collect"]
    assert table.pop("into").endswith(".parquet")
    assert all(read_expression(entry) for entry in table.values())
    shown = re.findall(r"^\| `.*?\| (.*?) \| ", PAGE, re.M)
    texts = [text for cell in shown for text in re.findall(r"`([^`]+)`", cell)]
    assert len(texts) >= 9
    assert all(str(read_expression(text)) == text for text in texts)
