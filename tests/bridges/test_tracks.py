"""GPX tracks and tables as recordings."""

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import RecordingError
from minerva_services.bridging.testing import RunningBridge
from minerva_services.sensors.tracks import Csv, Gpx

GPX = """<?xml version="1.0"?>
<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="48.1" lon="11.5"><ele>520.5</ele><time>1970-01-01T00:00:10Z</time></trkpt>
<trkpt lat="48.2" lon="11.6"><time>1970-01-01T01:00:11.5+01:00</time></trkpt>
<trkpt lat="48.3" lon="11.6"/><trkpt lat="98" lon="11.6"><time>1970-01-01T00:00:12Z</time></trkpt>
<trkpt lat="north" lon="11.6"><time>yesterday</time></trkpt>
"""
END = "</trkseg></trk></gpx>"
TABLE = "stamp;pos_x;pos_y;yaw\n1000;1.5;2;0.5\n\n2000;x;2;0\n3000;3\n4000;4;5;1\n"
COLUMNS = {"time": "stamp", "x": "pos_x", "y": "pos_y", "angle": "yaw"}


def played(service, count):
    with RunningBridge(service) as running:
        readings = running.readings(count)
        running.wait_for(lambda: running.state == "ended", "its end")
        return readings, running.counted("rows skipped"), running.counted("broken off")


def saved(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(("end", "broken"), [(END, 0), ("<cut", 1)], ids=["whole", "cut"])
def test_a_track_is_positions(tmp_path, end, broken):
    service = Gpx(saved(tmp_path, "ride.gpx", GPX + end), speed=0)
    (first, second), skipped, broken_off = played(service, 2)
    assert (first.latitude, first.longitude, first.altitude, first.time) == (48.1, 11.5, 520.5, 10)
    assert (second.latitude, second.altitude, second.time) == (48.2, None, 11.5)
    assert (skipped, broken_off) == (3, broken)


def test_rows_are_readings_of_mapped_columns(tmp_path):
    factors = {"time": 0.001, "angle": 100.0}
    path = saved(tmp_path, "drive.csv", "\ufeff" + TABLE)
    (first, last), skipped, _ = played(Csv(path, columns=COLUMNS, factors=factors, speed=0), 2)
    assert (first.time, first.x, first.y, first.angle, first.turn) == (1.0, 1.5, 2.0, 50.0, 0.0)
    assert (last.time, last.x, skipped) == (4.0, 4.0, 2)


def test_dates_and_commas(tmp_path):
    table = 'time,charge\n"1970-01-01 00:01:00",0.5\n61,5\n'
    (reading,), skipped, _ = played(Csv(saved(tmp_path, "b.csv", table), "battery", speed=0), 1)
    assert (reading.time, reading.charge, reading.volts, skipped) == (60.0, 0.5, 0.0, 1)


@pytest.mark.parametrize(
    ("text", "options", "why"),
    [
        (TABLE, {}, "no column 'x' for x; the columns are stamp, pos_x, pos_y, yaw; set columns"),
        (TABLE, {"columns": {**COLUMNS, "x": "X"}}, "no column 'X' for x"),
        ("", {}, "no column 'x'"),
        ("time,x,y\n1,2\n", {}, "no reading; .*y is ''; expected a number"),
        ("x" * (1 << 20), {}, "a line of more than 1 MB"),
    ],
)
def test_tables_that_cannot_be_played(tmp_path, text, options, why):
    with pytest.raises(RecordingError, match=why):
        list(Csv(saved(tmp_path, "t.csv", text), **options).recording().readings())


@pytest.mark.parametrize("text", ["", "no xml", GPX[:120], END])
def test_tracks_without_points(tmp_path, text):
    with pytest.raises(RecordingError, match=r"t\.gpx: no reading"):
        list(Gpx(saved(tmp_path, "t.gpx", text)).recording().readings())


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"reading": "odometri"}, "did you mean 'odometry'"),
        ({"columns": {"z": "a"}}, "odometry has no such field"),
        ({"columns": {"x": 1}}, "columns.x is 1"),
        ({"factors": {"x": "1"}}, "factors.x is '1'"),
    ],
)
def test_wrong_options_of_a_table(tmp_path, options, why):
    with pytest.raises(MisuseError, match=why):
        Csv(saved(tmp_path, "t.csv", TABLE), **options)
