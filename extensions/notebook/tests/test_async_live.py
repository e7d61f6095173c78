"""Live worlds for asyncio."""

import asyncio

import pytest

from minerva_bus import run
from minerva_notebook import start_async
from tests.api.frogs import eFeed, pond

MANY = 10**8


@pytest.fixture(autouse=True)
def own_runtime_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path / "runtime"))


def test_asyncio_steps_a_world_without_blocking():
    async def main():
        ticks = 0

        async def tick():
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0)

        async with start_async(pond(), seed=5) as live:
            task = asyncio.create_task(tick())
            await live.step(20)
            task.cancel()
            assert await live.digest() == run(pond(), seed=5, frames=20).digest
            assert await live.frame() == 20
            assert not await live.ended()
            await live.publish(eFeed(amount=1.0))
            assert (await live.view("ePicture")) != (await live.scene())
        return ticks

    assert asyncio.run(main()) > 1


@pytest.mark.parametrize("bus", [False, True])
def test_a_cancelled_step_ends_after_its_frame(bus):
    async def main():
        async with start_async(pond(), seed=3, bus=bus) as live:
            before = await live.step(2)
            step = asyncio.create_task(live.step(MANY))
            while live._world.frame <= before + 1:
                await asyncio.sleep(0)
            step.cancel()
            with pytest.raises(asyncio.CancelledError):
                await step
            # It would wait for a hundred million frames otherwise.
            stopped = await live.frame()
            assert before < stopped < MANY
            assert await live.frame() == stopped
            assert await live.step() == stopped + 1

    asyncio.run(main())
