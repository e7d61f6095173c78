"""Runs of worlds in one process, without a bus."""

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import Begin, FrameDone
from minerva_bus.runtime.runner import InProcessRunner


def run_world(world, members, watch=lambda done, scene: None, before=()):
    """Run a world to its end; returns its runner.

    Calls `watch` with the result of each frame and the string after it; handles the stimuli in
    `before` ahead of the first frame.
    """
    algorithm = FrameAlgorithm(world)

    def on_instruction(instruction):
        if isinstance(instruction, FrameDone):
            watch(instruction, algorithm.scene)

    runner = InProcessRunner(algorithm, members, on_instruction)
    runner.start()
    for stimulus in before:
        runner.handle(stimulus)
    while runner.ended is None:
        runner.handle(Begin())
    assert not algorithm.failed, runner.ended.reason
    return runner


def run_file(file, *guests, watch=lambda done, scene: None):
    """Run a world file to its end, with more members."""
    members = [process.make_member() for process in file.processes]
    return run_world(file.world, [*members, *guests], watch)
