"""The bridge that docs/bridges.md defines."""

from pathlib import Path

from minerva_services.bridging.testing import RunningBridge

ROOT = Path(__file__).parents[2]


def test_the_bridge_in_the_document_works(tmp_path):
    page = (ROOT / "docs" / "bridges.md").read_text(encoding="utf-8")
    blocks = [block.partition("```")[0] for block in page.split("```python")[1:]]
    world = {}
    exec(blocks[0].partition("\n")[2], world)  # the first line is the file name
    exec(blocks[1], world)
    world["test_a_battery_is_read"](tmp_path)
    (tmp_path / "capacity").write_text("much")
    with RunningBridge(world["Laptop"](str(tmp_path))) as running:
        running.wait_for(lambda: running.counted("garbage"), "garbage is counted")
        (tmp_path / "capacity").unlink()
        running.wait_for(lambda: "is gone" in running.state, "the file is missed")
