"""Draw `minerva top` for the only running world: draw_top.py FILE.png."""

import asyncio
import re
import sys
from pathlib import Path

import resvg_py

from minerva_bus.cli.options import WorldTarget
from minerva_bus.cli.places import client
from minerva_monitoring.top_dashboard import Dashboard

SIZE = (132, 40)
SECONDS = 6.0


async def drawn(dashboard: Dashboard) -> str:
    """The screen after some seconds, as SVG."""
    async with dashboard.run_test(size=SIZE) as pilot:
        await pilot.pause(SECONDS / 2)
        await pilot.press("e")
        await pilot.pause(SECONDS / 2)
        return dashboard.export_screenshot(title="minerva top")


def main() -> None:
    """Write the picture."""
    with client(WorldTarget()) as asked:
        svg = asyncio.run(drawn(Dashboard(asked.operator)))
    svg = re.sub(r"@font-face \{.*?\}", "", svg, flags=re.S).replace(
        "Fira Code", "DejaVu Sans Mono"
    )
    Path(sys.argv[1]).write_bytes(bytes(resvg_py.svg_to_bytes(svg_string=svg, width=1600)))


main()
