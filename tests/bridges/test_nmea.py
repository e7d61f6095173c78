"""The bridge to NMEA 0183 receivers, over a cable that can be unplugged."""

import socket
import threading
from functools import reduce
from operator import xor

import pytest
from serial_rig import Cable

pytest.importorskip("serial", reason="the extra `serial` is not installed")
pytest.importorskip("pynmea2", reason="the extra `serial` is not installed")

from minerva_bus import MinervaError
from minerva_bus.world.readings import Position
from minerva_services.bridging.testing import RunningBridge
from minerva_services.sensors.nmea import Nmea
from minerva_services.sensors.nmea.service import Fix, SkippedSentence, read_fix
from minerva_services.sensors.serial_line import LineSplitter
from tests.patience import patience


def said(body):
    """A sentence with its checksum, computed independently of the bridge."""
    return f"${body}*{reduce(xor, body.encode()):02X}"


def gga(time="120000.00", lat="5230.0000,N", lon="01324.0000,E", quality=1, hdop="0.8", up="34.5"):
    return said(f"GPGGA,{time},{lat},{lon},{quality},09,{hdop},{up},M,45.0,M,,")


def rmc(time="120000.00", status="A"):
    return said(f"GNRMC,{time},{status},5230.0000,N,01324.0000,E,0.5,90.0,211126,,,A")


@pytest.fixture
def cable(tmp_path):
    with Cable(tmp_path / "gps") as plugged:
        yield plugged


def tell(cable, *lines):
    assert cable.write("".join(f"{line}\r\n" for line in lines).encode())


def positions(cable, *lines, **options):
    """The report, and the positions of some lines without that of the final GGA sentence."""
    with RunningBridge(Nmea(port=str(cable.path), **options)) as runs:
        runs.wait_for(lambda: runs.state == "open", "it is open")
        tell(cable, *lines, gga(time="235959.00", up="8848.0"))
        runs.wait_for(lambda: runs.published and runs.published[-1][1].altitude == 8893.0, "heard")
        return runs.bridge.report(), [reading for _, reading in runs.published[:-1]]


def test_a_fix_becomes_a_position(cable):
    report, (fix,) = positions(cable, gga(), robot="boat", error=2.0)
    assert fix == Position("boat", 52.5, pytest.approx(13.4), 79.5, pytest.approx(1.6), 43200.0)
    assert report["readings"] == 2


def test_south_and_west_are_negative(cable):
    _, (fix,) = positions(cable, gga(lat="3352.1200,S", lon="07030.0000,W"))
    assert (fix.latitude, fix.longitude) == (pytest.approx(-33.868667), -70.5)


def gns(time="120000.00", mode="NANN"):
    return said(f"GNGNS,{time},5230.0000,N,01324.0000,E,{mode},13,0.8,34.5,45.0,,")


def gll(time="120000.00", status="A"):
    return said(f"ECGLL,5230.0000,N,01324.0000,E,{time},{status},D")


def test_lesser_sentences_count_until_a_better_one_arrives(cable):
    said = gll("115958.50"), rmc("115959.50"), gll("115959.50"), gns(), rmc(), gga(), gns(), gll()
    report, fixes = positions(cable, *said)
    assert [fix.time for fix in fixes] == [43198.5, 43199.5, 43200.0, 43200.0]
    assert (fixes[0].altitude, fixes[1].accuracy) == (None, None)
    assert fixes[2] == fixes[3]
    assert report["other sentences"] == 4


def test_lesser_sentences_count_again_when_better_ones_stay_away(cable):
    _, fixes = positions(cable, gga(), gns("120010.00"), gns("120011.00"), rmc("120020.00"))
    assert [fix.time for fix in fixes] == [43200.0, 43211.0]


@pytest.mark.parametrize(
    ("fields", "altitude", "accuracy"),
    [
        ({"hdop": ""}, 79.5, None),
        ({"hdop": "0.0"}, 79.5, None),
        ({"up": ""}, None, pytest.approx(4.0)),
        ({"up": "-45.0"}, 0.0, pytest.approx(4.0)),
    ],
)
def test_missing_fields_of_a_sentence_are_unknown(cable, fields, altitude, accuracy):
    _, (position,) = positions(cable, gga(**fields))
    assert (position.altitude, position.accuracy) == (altitude, accuracy)


def test_sentences_without_a_position_are_counted_by_reason(cable):
    report, fixes = positions(
        cable,
        gga(quality=0),
        rmc(status="V"),
        gns(mode="NN"),
        gll(status="V"),
        gga(lat=",", lon=","),
        gga()[:-2] + "00",
        gga()[:-3],
        said("GPGSV,1,1,00"),
        said("PMTK001,1,2"),
        "\x00\xff no sentence at all",
        said("GPGGA,never,5230.0,N,01324.0,E,1,09,0.8,34.5,M,45.0,M,,"),
        gga(lat="9930.0000,N"),
        gga(up="nan"),
        "x" * 1000,
    )
    assert fixes == []
    assert report["without a fix"] == 5
    assert report["checksum errors"] == 2
    assert report["other sentences"] >= 1
    assert report["garbage"] >= 4


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"lat": "5230.0000,"}, "hemisphere ''; expected N or S"),
        ({"lat": "5230.0000,n"}, "hemisphere 'n'; expected N or S"),
        ({"lat": "5230.0000,E"}, "hemisphere 'E'; expected N or S"),
        ({"lon": "01324.0000,"}, "hemisphere ''; expected E or W"),
        ({"lon": "01324.0000,EW"}, "hemisphere 'EW'; expected E or W"),
        ({"lat": "5275.0000,N"}, "5275.0000 is not degrees and minutes up to 90°"),
        ({"lon": "18100.0000,E"}, "18100.0000 is not degrees and minutes up to 180°"),
        ({"up": "inf"}, "inf is not finite"),
    ],
)
def test_invalid_values_are_refused_with_their_sentence(fields, why):
    with pytest.raises(SkippedSentence, match="garbage") as skipped:
        read_fix(gga(**fields))
    assert skipped.value.detail == f"{gga(**fields)!r} skipped: {why}"


def test_the_first_invalid_sentence_is_logged(cable, capsys):
    report, fixes = positions(cable, gga(lat="5230.0000,"), gga(lat="5230.0000,"))
    assert (fixes, report["garbage"]) == ([], 2)
    out = capsys.readouterr().out
    assert out.count("hemisphere ''; expected N or S; further ones are counted as 'garbage'") == 1


def test_midnight_does_not_turn_time_back_and_a_clock_that_jumps_is_followed(cable):
    _, fixes = positions(cable, gga("235959.00"), gga("000001.00"), gga("000000.50"), gga("010000"))
    assert [fix.time for fix in fixes] == [86399.0, 86401.0, 86400.5, 90000.0]


def fix_times(*times):
    receiver = Nmea("/dev/null")
    return [receiver._position(read_fix(gga(time)))[1].time for time in times]


def test_a_late_sentence_after_midnight_is_of_the_day_before():
    times = fix_times("235959.80", "000000.00", "235959.90", "000000.20")
    assert times == pytest.approx([86399.8, 86400.0, 86399.9, 86400.2])
    assert fix_times("000000.10", "235959.90", "000000.30") == pytest.approx([0.1, -0.1, 0.3])


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (("200000.00", "100000.00"), [72000.0, 122400.0]),
        (("100000.00", "230000.00", "103000.00"), [36000.0, 82800.0, 124200.0]),
        (("120000.00", "111500.00", "120000.00"), [43200.0, 40500.0, 43200.0]),
    ],
)
def test_after_a_gap_of_hours_time_does_not_go_back(times, seconds):
    assert fix_times(*times) == seconds


def test_a_clock_that_is_set_back_is_reported_with_its_size_and_place(cable, capsys):
    report, fixes = positions(cable, gga("120000.00"), gga("115950.00"), gga("115951.00"))
    assert [fix.time for fix in fixes] == [43200.0, 43190.0, 43191.0]
    assert report["clock steps back"] == 1
    line = f"the receiver at {cable.path}: the clock steps back by 10.0 s, to 43190.0 s"
    assert line in capsys.readouterr().out


def test_a_sentence_may_arrive_in_parts_and_inside_another(cable):
    with RunningBridge(Nmea(port=str(cable.path))) as runs:
        runs.wait_for(lambda: runs.state == "open", "it is open")
        for byte in (gga()[20:] + "\r\n" + gga()[:30] + gga() + "\r\n").encode():
            cable.write(bytes((byte,)))
        (fix,) = runs.readings(1)
        assert fix.latitude == 52.5


@pytest.mark.parametrize("end", ["\r\n", "\n", ""])
def test_a_server_that_sends_while_it_is_connected_and_closes_loses_nothing(monkeypatch, end):
    sent, connect = threading.Event(), socket.create_connection

    def connected(*address, **options):
        made = connect(*address, **options)
        assert sent.wait(patience())
        return made

    def serve():
        client, _ = server.accept()
        with client:
            client.sendall(("\r\n".join(gga(f"1200{k:02d}.00") for k in range(20)) + end).encode())
        sent.set()

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        monkeypatch.setattr(socket, "create_connection", connected)
        with RunningBridge(Nmea(f"socket://127.0.0.1:{server.getsockname()[1]}")) as runs:
            runs.wait_for(lambda: runs.counted("failures"), "it has closed")
            fixes = [reading.time for _, reading in runs.published]
    assert fixes == [43200.0 + k for k in range(20)]
    assert runs.counted("garbage") == 0


def test_pulled_out_and_plugged_in_again(cable, capsys):
    with RunningBridge(Nmea(port=str(cable.path))) as runs:
        runs.wait_for(lambda: runs.state == "open", "it is open")
        tell(cable, gga())
        runs.readings(1)
        cable.pull()
        runs.wait_for(lambda: runs.counted("failures"), "it is missed")
        cable.plug()
        runs.wait_for(lambda: runs.state == "open", "it is open again")
        tell(cable, gga(time="120001.00"))
        assert runs.readings(1, after=1)[0].time == 43201.0
    lost, back = capsys.readouterr().out.splitlines()
    assert lost.startswith(f"{cable.path} ")
    assert back == f"the receiver at {cable.path} is back"


def test_a_line_without_end_takes_no_memory():
    counted = []
    lines = LineSplitter(counted.append, longest=10)
    assert list(lines.feed(b"x" * 11)) == []
    assert counted == ["garbage"]
    assert list(lines.feed(b"ab\r\n\ncd\n")) == ["ab", "cd"]


def test_wrong_options():
    with pytest.raises(MinervaError, match=r"nmea: error is 0.0; expected metres above 0"):
        Nmea(error=0.0)


def test_any_talker_is_understood():
    assert read_fix(said("GAGGA,000000,5230.0,N,01324.0,E,4,,,,M,,M,,")) == Fix(
        "GGA", 52.5, 13.4, None, None, 0.0
    )
    with pytest.raises(SkippedSentence, match="checksum errors"):
        read_fix("$GPGGA,1*00")
