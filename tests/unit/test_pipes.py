"""Pipes of which one is closed while another is read."""

import os

from minerva_bus.launch.pipes import Pipes


def test_a_pipe_read_to_its_end_is_not_read_again():
    pipes, heard = Pipes(), []
    ends = [os.pipe() for _ in range(2)]

    def hear_all():
        heard.append("once")
        for read, _ in ends:
            assert pipes.read(read) is None  # and closes it

    for read, write in ends:
        pipes.listen(read, hear_all)
        os.close(write)
    pipes.wait(5.0)
    assert heard == ["once"]
    pipes.close()
