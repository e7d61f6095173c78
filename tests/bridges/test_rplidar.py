"""The RPLIDAR bridge with an emulated lidar, over a cable that can be unplugged."""

import errno
from itertools import islice, repeat

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lidar_emulator import Emulator, capsule, capsules, descriptor, room, samples, standard_sample
from serial_rig import Cable

pytest.importorskip("serial", reason="the extra `serial` is not installed")

from minerva_bus import Degrees, EventType, Frame, Metres, MinervaError, Tick, Vocabulary, WorldInfo
from minerva_services.bridging.testing import RunningBridge
from minerva_services.sensors.laser import Laser
from minerva_services.sensors.rplidar import Rplidar, packets
from minerva_services.sensors.rplidar.packets import (
    MAX_SAMPLES,
    ExpressPackets,
    RevolutionBuffer,
    Samples,
    StandardPackets,
    ranges,
)
from tests.patience import patience

BEAMS = 120


@pytest.fixture
def cable(tmp_path):
    with Cable(tmp_path / "lidar") as plugged:
        yield plugged


def bridge(cable, **options):
    return Rplidar(port=str(cable.path), beams=BEAMS, **options)


def wall(beams=BEAMS):
    """The true ranges of a scan of the room, counter-clockwise."""
    return np.array([room(-i * 360 / beams) for i in range(beams)])


def off(scan):
    """Largest range error of a scan in metres, over all beams with a hit."""
    ranges = np.asarray(scan.ranges, float)
    return float(np.abs(ranges - wall(len(ranges)))[ranges > 0].max())


# --- complete scans over a serial line ---


@pytest.mark.parametrize("mode", ["express", "standard"])
def test_turns_become_scans(cable, mode, capsys):
    with Emulator(cable) as lidar:
        with RunningBridge(bridge(cable, mode=mode, topic="front")) as runs:
            for scan in runs.readings(3):
                assert (scan.robot, scan.first, scan.step, scan.range_max) == ("r1", 0, 3.0, 12.0)
                assert (scan.ranges > 0).all()
                assert off(scan) < 0.06
            assert {topic for topic, _ in runs.published} == {"front"}
            assert runs.bridge.report()["health"] == "good"
            assert runs.state == "open"
        lidar.hears(b"\xa5\x25", packets.motor(0))
    assert (b"\xa5\x20" in lidar.heard) == (mode == "standard")
    assert "model 24, firmware 1.29, serial number 000102" in capsys.readouterr().out


@pytest.mark.parametrize(("firmware", "command"), [((1, 16), 0x20), ((1, 17), 0x82)])
def test_by_itself_it_does_what_the_firmware_can(cable, firmware, command):
    with Emulator(cable, firmware=firmware) as lidar, RunningBridge(bridge(cable)) as runs:
        runs.readings(1)
        scans = [said[1] for said in lidar.heard if said[1] in (0x20, 0x82)]
        assert scans == [command]


@pytest.mark.parametrize(
    ("express", "why"),
    [
        ((0x85, capsules), "data of type 0x85"),
        ((0x82, lambda: repeat(b"")), "stopped sending"),
        ((0x82, lambda: repeat(b"\xa5\x5a" + bytes(82))), "no revolution"),
    ],
    ids=["another type", "no packets", "damaged packets"],
)
def test_without_revolutions_it_changes_to_the_standard_mode(
    cable, capsys, monkeypatch, express, why
):
    limits = {"FIRST_PACKET_SECONDS": 0.3, "REVOLUTION_SECONDS": patience(1.5)}
    for limit, seconds in limits.items():
        monkeypatch.setattr(f"minerva_services.sensors.rplidar.service.{limit}", seconds)
    with Emulator(cable, express=express) as lidar, RunningBridge(bridge(cable)) as runs:
        assert off(runs.readings(1)[0]) < 0.06
        scans = [said[1] for said in lidar.heard if said[1] in (0x20, 0x82)]
        assert scans[:2] == [0x82, 0x20]
    assert why in capsys.readouterr().out


def test_scans_carry_their_mount(cable):
    at = bridge(cable, mount_x=0.1, mount_y=-0.2, mount_angle=90.0, robot="r7", range_max=6.0)
    with Emulator(cable), RunningBridge(at) as runs:
        (scan,) = runs.readings(1)
    assert (scan.mount_x, scan.mount_y, scan.mount_angle) == (0.1, -0.2, 90.0)
    assert (scan.robot, scan.range_max) == ("r7", 6.0)


@pytest.mark.parametrize("mode", ["express", "standard"])
@pytest.mark.parametrize("part", [1, 7])
def test_bytes_may_arrive_in_any_parts(cable, mode, part):
    with Emulator(cable, part=part), RunningBridge(bridge(cable, mode=mode)) as runs:
        assert off(runs.readings(1)[0]) < 0.06
        assert runs.counted("damaged packets") == 0


@pytest.mark.parametrize("mode", ["express", "standard"])
def test_damage_is_counted_and_the_rest_goes_on(cable, mode):
    def breaks(n, packet):
        if n % 50 != 20:
            return packet
        return b"\xff\x00\xa5" + packet if mode == "standard" else packet[:40] + packet[41:]

    with Emulator(cable, breaks=breaks), RunningBridge(bridge(cable, mode=mode)) as runs:
        for scan in runs.readings(4):
            assert off(scan) < 0.06
        assert runs.counted("damaged packets") > 0


def test_a_cable_pulled_in_mid_scan_and_plugged_in_again(cable, capsys):
    with Emulator(cable) as lidar, RunningBridge(bridge(cable)) as runs:
        runs.readings(1)
        cable.pull()
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
        lidar.packets = None
        had = len(runs.published)
        cable.plug()
        for scan in runs.readings(2, after=had):
            assert off(scan) < 0.06
        assert runs.state == "open"
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 3, said
    assert "retrying" in said[1]
    assert said[2] == f"the lidar at {cable.path} is back"


def test_a_lidar_that_falls_silent_is_started_again(cable, monkeypatch):
    monkeypatch.setattr("minerva_services.sensors.rplidar.service.FIRST_PACKET_SECONDS", 0.2)
    with Emulator(cable) as lidar, RunningBridge(bridge(cable)) as runs:
        runs.readings(1)
        lidar.mute = True
        runs.wait_for(lambda: "silent" in runs.state, "its silence is said")
        lidar.packets, lidar.mute = None, False
        had = len(runs.published)
        runs.readings(1, after=had)


def test_a_lidar_in_error_is_reset_once_and_goes_on(cable):
    boot = b"RP LIDAR System.\r\nFirmware Ver 1.29\r\n"
    with Emulator(cable, healths=(2, 1), boot=boot) as lidar, RunningBridge(bridge(cable)) as runs:
        runs.readings(1)
        assert lidar.heard.count(b"\xa5\x40") == 1
        assert runs.bridge.report()["health"] == "warning 0x8001"


def test_a_persistent_lidar_error_is_reported(cable, capsys):
    with Emulator(cable, healths=(2,)), RunningBridge(bridge(cable)) as runs:
        runs.wait_for(lambda: runs.counted("failures"), "its error is told")
        assert "is in protection mode (error 0x8001)" in runs.state
    assert "is in protection mode (error 0x8001); disconnect its power" in capsys.readouterr().out


def test_a_missing_and_an_unresponsive_endpoint(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("minerva_services.sensors.rplidar.service.ANSWER_SECONDS", 0.1)
    cable = Cable(tmp_path / "lidar")
    with RunningBridge(bridge(cable)) as runs:
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
        assert "no such device (is it plugged in?)" in runs.state
        cable.plug()
        runs.wait_for(lambda: "no answer" in runs.state, "nobody is there")
        failures = runs.counted("failures")
        runs.wait_for(lambda: runs.counted("failures") > failures, "and once more")
    cable.pull()
    missed, dumb = capsys.readouterr().out.splitlines()  # One line per reason.
    assert "no such device" in missed
    assert "no answer" in dumb


def test_a_device_that_is_no_lidar_is_reported(cable, monkeypatch):
    monkeypatch.setattr("minerva_services.sensors.rplidar.service.ANSWER_SECONDS", 0.2)
    with RunningBridge(bridge(cable)) as runs:

        def chatters():
            cable.write(b"$GPGGA,no lidar at all\r\n")
            return "unintelligible answer" in runs.state

        runs.wait_for(chatters, "it is told")


def test_a_line_that_another_process_uses(cable):
    with Emulator(cable), RunningBridge(bridge(cable)) as first:
        first.readings(1)
        with RunningBridge(bridge(cable)) as second:
            second.wait_for(lambda: second.counted("failures"), "it is told")
            assert "another process uses it" in second.state


def test_the_ioctl_of_dtr_may_fail():
    from minerva_services.sensors.serial_line import SerialLine

    class Device:
        @property
        def dtr(self):
            raise AssertionError

        @dtr.setter
        def dtr(self, on):
            raise OSError(errno.ENOTTY, "no such line")

    SerialLine("x", Device()).set_dtr(True)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"mode": "fast"}, "mode is 'fast'; expected one of auto, express, standard"),
        ({"beams": 0}, "beams is 0; expected 1 to 7200"),
        ({"range_max": 0.0}, "range_max is 0.0; expected metres above 0"),
    ],
)
def test_wrong_options(options, problem):
    with pytest.raises(MinervaError, match=problem):
        Rplidar(**options)


def test_the_laser_does_not_know_that_the_lidar_is_real(cable):
    eLaser = EventType("eLaser", dist=Metres, angle=Degrees)
    laser = Laser(every=BEAMS // 4)
    laser.joined(WorldInfo("yard", Vocabulary.of(eLaser), 0, 0.1))
    with Emulator(cable), RunningBridge(bridge(cable)) as runs:
        (scan,) = runs.readings(1)
    hits = list(laser.generate(Tick(Frame(1, 0.1, 0), "laser", readings=(scan,))))
    assert [(hit.angle, hit.receivers) for hit in hits] == [(a, ("r1",)) for a in (0, 90, 180, 270)]
    assert [hit.dist for hit in hits] == pytest.approx(
        [room(-a) for a in (0, 90, 180, 270)], abs=0.06
    )


# --- packets ---


class Counts(dict):
    def __call__(self, what):
        self[what] = self.get(what, 0) + 1


def fed(packets, data, part=64):
    """All samples in the data as one object; the data arrive in parts."""
    scans = [
        scan for at in range(0, len(data), part) for scan in packets.feed(data[at : at + part])
    ]
    return Samples(*(np.concatenate([getattr(o, n) for o in scans]) for n in Samples.__slots__))


def test_the_document_s_formula_gives_the_angles_of_a_capsule():
    first = [(1.0 + k / 100, 2 * k) for k in range(32)]
    data = capsule(350.0, first) + capsule(6.0, first)
    samples = fed(ExpressPackets(Counts()), data)
    raw = [350.0 + 16.0 / 32 * k for k in range(32)]
    assert samples.angles == pytest.approx([(a - 2 * k / 8) % 360 for k, a in enumerate(raw)])
    assert samples.distances == pytest.approx([metres for metres, _ in first])
    assert samples.starts.nonzero()[0].tolist() == [20]


def test_a_turn_begins_once_however_capsules_lie():
    data = b"".join(islice(capsules(step=1.05, angle=3.7), 60))
    samples = fed(ExpressPackets(Counts()), data)
    begun = np.flatnonzero(samples.starts)
    assert set(np.diff(begun)) <= {342, 343}
    assert len(begun) == int((59 * 32 * 1.05 + 3.7) // 360)


def test_no_angle_is_made_up_across_a_lost_capsule():
    stream = list(islice(capsules(), 12))
    counts = Counts()
    samples = fed(ExpressPackets(counts), b"".join(stream[:4] + stream[8:]))
    assert counts == {"lost packets": 1}
    assert np.abs(samples.distances - [room(a) for a in samples.angles]).max() < 0.02


def test_a_sample_of_no_distance_is_no_hit():
    turn = Samples(np.array([0.0, 90.0]), np.array([0.0, 2.0]), np.zeros(2, bool))
    assert ranges(turn, 4).tolist() == [0.0, 0.0, 0.0, 2.0]


def test_of_several_samples_for_a_beam_the_nearest_hit_counts():
    turn = Samples(np.array([359.8, 0.1, 0.3]), np.array([3.0, 2.0, 0.0]), np.zeros(3, bool))
    assert ranges(turn, 360)[0] == 2.0


def test_a_partial_first_turn_is_dropped_and_endless_turns_are_aborted():
    counts, stream = Counts(), fed(StandardPackets(Counts()), b"".join(islice(samples(), 800)))
    whole = list(RevolutionBuffer(counts).add(stream))
    assert [len(turn.angles) for turn in whole] == [360, 360]
    assert whole[0].angles[0] == 0.0
    turns = RevolutionBuffer(counts)
    still = Samples(np.zeros(1000), np.ones(1000), np.zeros(1000, bool))
    list(turns.add(stream))
    for _ in range(MAX_SAMPLES // 1000 + 1):
        assert not list(turns.add(still))
    assert counts == {"endless turns": 1}


@settings(max_examples=40)
@given(
    noise=st.lists(st.binary(max_size=300), min_size=1, max_size=3),
    part=st.integers(1, 300),
    express=st.booleans(),
)
def test_after_any_garbage_it_is_in_step_again(noise, part, express):
    """After each burst of garbage the decoder resynchronizes within half of the packets."""
    counts = Counts()
    packets, made = (
        (ExpressPackets(counts), list(islice(capsules(), 20)))
        if express
        else (StandardPackets(counts), list(islice(samples(), 400)))
    )
    data = b"".join(garbage + b"".join(made) for garbage in noise)
    parsed = fed(packets, data, part)
    tail = fed(type(packets)(Counts()), b"".join(made[10:] if express else made[200:]))
    count = len(tail.angles)
    assert parsed.angles[-count:] == pytest.approx(tail.angles)
    assert parsed.distances[-count:] == pytest.approx(tail.distances)


def test_of_noise_hardly_anything_is_taken_for_samples():
    noise = np.random.default_rng(7).integers(0, 256, 20_000, np.uint8).tobytes()
    made = b"".join(islice(samples(), 100))
    assert 190 < len(fed(StandardPackets(Counts()), made + noise + made).angles) < 230


def test_descriptors_and_requests():
    assert packets.read_descriptor(descriptor(84, 1, 0x82)) == packets.CAPSULES
    assert packets.read_descriptor(descriptor(5, 1, 0x81)) == packets.SAMPLES
    assert packets.read_descriptor(b"\xa5\x5b\x05\x00\x00\x40\x81") is None
    assert bytes.fromhex("A5 82 05 00 00 00 00 00 22") == packets.EXPRESS
    assert packets.request(0x52) == b"\xa5\x52"
    assert len(standard_sample(0, 1, True)) == packets.SAMPLES.size
