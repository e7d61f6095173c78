"""A handler may close the pipe of another one."""

import os

from minerva_bus.launch.pipes import Pipes
from tests.patience import patience


def test_the_handler_of_a_closed_pipe_is_not_called():
    pipes, calls = Pipes(), []
    ends = [os.pipe() for _ in range(2)]

    def read_all():
        calls.append("once")
        for read, _ in ends:
            assert pipes.read(read) is None  # and closes it

    for read, write in ends:
        pipes.listen(read, read_all)
        os.close(write)
    pipes.wait(patience(5))
    assert calls == ["once"]
    pipes.close()
