"""Links between regions through proxies, which can hold back everything."""

import asyncio
import threading

SCRIPT = """
from minerva_bus.cli.main import main
from minerva_bus.launch.regions import process as region_process
from minerva_bus.runtime.region_links import RegionLinks


class Proxied(RegionLinks):
    def __init__(self, keys, number, endpoints, arrivals, **more):
        through = {
            region: at if region == number else at.replace(".sock", ".proxy")
            for region, at in endpoints.items()
        }
        super().__init__(keys, number, through, arrivals, **more)


region_process.RegionLinks = Proxied
main()
"""


class Proxy(threading.Thread):
    """Passes on the links of regions to one region, whose socket is in this folder."""

    def __init__(self, folder, number):
        super().__init__(daemon=True)
        self._socket = f"{folder}/{number}.sock"
        self._proxy = f"{folder}/{number}.proxy"
        self._loop = asyncio.new_event_loop()
        self._up = asyncio.Event()
        self._up.set()

    def run(self):
        self._loop.run_until_complete(self._serve())

    def cut(self):
        self._loop.call_soon_threadsafe(self._up.clear)

    def restore(self):
        self._loop.call_soon_threadsafe(self._up.set)

    async def _serve(self):
        async with await asyncio.start_unix_server(self._accept, self._proxy) as server:
            await server.serve_forever()

    async def _accept(self, reader, writer):
        try:
            back, there = await asyncio.open_unix_connection(self._socket)
        except OSError:  # The region does not listen yet, and is dialled again.
            writer.close()
            return
        await asyncio.gather(self._pump(reader, there), self._pump(back, writer))

    async def _pump(self, reader, writer):
        try:
            while data := await reader.read(65536):
                await self._up.wait()
                writer.write(data)
                await writer.drain()
        except OSError:
            pass  # The other side has closed the link.
        finally:
            writer.close()
