"""Lines of the log about violations."""

from street import eShout, street

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import Notify
from minerva_bus.world.norms import Norm, Then


def test_the_first_violation_is_logged_under_the_name_of_norms():
    quiet = Norm("quiet", on=("eShout",), then=Then.COUNT)
    algorithm = FrameAlgorithm(street("ARunner#a", (quiet,)))
    for _ in range(2):
        algorithm.norms.events(0, {"crier": [eShout(1.0, sender="a")]})
    algorithm.norms.publish(algorithm.out, algorithm.inbox, {})
    (line,) = [each for each in algorithm.out.pending if isinstance(each, Notify)]
    assert line.member == "norms"
    assert line.text.endswith(": allowed; from now on this is only counted")
