"""What notebooks show of runs and live worlds, and live worlds for asyncio.

displays      pictures, films and runs as HTML: the entry point `minerva.displays`
live_widget   a live world with buttons
async_live    `start_async`: a live world whose methods are awaited
"""

from minerva_bus.public_names import imported_at_first_use

TYPE_CHECKING = False
if TYPE_CHECKING:
    from minerva_notebook.async_live import AsyncLive, start_async

__getattr__ = imported_at_first_use(__name__, {"async_live": "AsyncLive start_async"})

__all__ = ["AsyncLive", "start_async"]
