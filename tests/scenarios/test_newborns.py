"""Events for newborns: section 9 of PROTOCOL.md."""

from pond import VOCABULARY, Counter, Mother, eAdd

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.compatibility import PROTOCOL_VERSION
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.world.when import Participation, When

FREELY = When(Participation.FREELY)


def test_a_newborn_gets_no_event_of_the_frame_of_its_birth_and_all_of_the_next():
    world = FrameAlgorithm(World("w", VOCABULARY.read("AMother#m"), VOCABULARY))
    host = Member("host", None, [Mother, Counter])

    def tell(stimulus):
        for message in world.receive(stimulus):
            if isinstance(message, s.Send) and message.to in ("host", s.HOSTS, s.EVERYONE):
                for said in host.receive(message.message):
                    tell(said)

    tell(s.Appeared("host"))
    tell(s.Appeared("rain"))
    tell(m.Hello("rain", PROTOCOL_VERSION, generates=("eAdd",), when=FREELY))
    early = eAdd(100, receivers=["m:1"])
    tell(m.Emitted("rain", (eAdd(1), eAdd(2), early)))
    tell(s.Begin())
    assert "ACounter#m:1<n=1>" in str(world.scene)
    assert "ACounter#m:2<n=2>" in str(world.scene)
    tell(m.Emitted("rain", (eAdd(10, receivers=["m:1"]),)))
    tell(s.Begin())
    assert "ACounter#m:1<n=11>" in str(world.scene)
