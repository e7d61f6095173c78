"""The sound of a view: files are read back and analysed by their spectrum."""

import math
import os
import signal
import subprocess
import sys
import wave
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import (
    EMPTY,
    Disc,
    EventType,
    Metres,
    MinervaError,
    Motion,
    Primitive,
    Scene,
    Transformation,
    View,
    Vocabulary,
    WorldInfo,
)
from minerva_services.views.sound import Sound
from minerva_services.views.sound.sonification import Synthesis, Tone

PCar = Primitive("PCar", Disc(0.2, heading=True), name=str)
PBird = Primitive("PBird", Disc(0.1, heading=True))
PHome = Primitive("PHome", Disc(0.1))
PBell = Primitive("PBell", name=str)
TAt = Transformation("TAt", Motion("x", "y"), x=Metres, y=Metres)
TTurn = Transformation("TTurn", Motion(turn="angle"), angle=float)
VOCABULARY = Vocabulary.of(
    *(PCar, PBird, PHome, PBell, TAt, TTurn),
    *(EventType("ePicture", visual=True), EventType("eOverlay", visual=True)),
)
RATE = 22050


def world(dt: float = 0.1) -> WorldInfo:
    return WorldInfo("street", VOCABULARY, 7, dt)


def car(x: float, y: float = 0.0, angle: float = 0.0, name: str = "a") -> Scene:
    return TAt(x, y)(TTurn(angle)(PCar(name)))


def home(x: float, y: float = 0.0) -> Scene:
    return TAt(x, y)(PHome())


def samples(path: Path) -> np.ndarray:
    """Samples of left and right, -1 to 1."""
    with wave.open(str(path)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (2, 2, RATE)
        raw = file.readframes(file.getnframes())
        assert len(raw) == 4 * file.getnframes()
    return np.frombuffer(raw, "<i2").reshape(-1, 2) / 32767


def peak(sound: np.ndarray) -> float:
    """The strongest frequency in Hz."""
    mono = sound.sum(axis=1) * np.hanning(len(sound))
    spectrum = np.abs(np.fft.rfft(mono, 16 * len(mono)))
    return float(np.argmax(spectrum)) * RATE / (16 * len(mono))


def strength(sound: np.ndarray, frequency: float) -> float:
    """The strength of a frequency, 0 to 1."""
    mono = sound.sum(axis=1) * np.hanning(len(sound))
    at = np.exp(-2j * math.pi * frequency * np.arange(len(mono)) / RATE)
    return float(abs(mono @ at)) * 4 / len(mono)


def play(path: Path, scenes: dict[int, Scene], dt: float = 0.1, **options: object) -> Sound:
    device = Sound(str(path), **options)  # type: ignore[arg-type]
    device.joined(world(dt))
    for frame, scene in scenes.items():
        device.show(View(frame, "ePicture", scene))
    return device


def heard(path: Path, scenes: dict[int, Scene], dt: float = 0.1, **options: object) -> np.ndarray:
    play(path, scenes, dt, **options).close()
    return samples(path)


def held(scene: Scene, frames: int = 10) -> dict[int, Scene]:
    return dict.fromkeys(range(frames), scene)


def seconds(sound: np.ndarray, begin: float, end: float) -> np.ndarray:
    return sound[round(begin * RATE) : round(end * RATE)]


def clicks(sound: np.ndarray) -> np.ndarray:
    """Times in seconds of onsets far above all voices."""
    high = np.abs(np.diff(sound.sum(axis=1), n=3)) > 0.2
    at = np.flatnonzero(high) / RATE
    return at[np.diff(at, prepend=-1.0) > 0.03]


@pytest.mark.parametrize("distance", [0.0, 1.0, 2.5, 5.0, 10.0, 15.0, 40.0])
def test_the_nearer_the_higher(tmp_path: Path, distance: float):
    scene = car(1.0, 1.0) + home(1.0, 1.0 + distance)
    sound = heard(tmp_path / "w.wav", held(scene))
    expected = max(110.0, 880.0 * 2 ** (-distance / 5.0))
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(expected, rel=0.01)


def test_pitch_follows_the_nearest_of_several_aims(tmp_path: Path):
    sound = heard(tmp_path / "w.wav", held(home(9.0) + home(-2.0) + car(0.0)))
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(880 * 2 ** (-2 / 5), rel=0.01)


def test_a_voice_without_an_aim_is_deep(tmp_path: Path):
    sound = heard(tmp_path / "w.wav", held(car(0.0)), low=150.0)
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(150.0, rel=0.01)


def test_each_robot_has_a_voice_at_its_position(tmp_path: Path):
    scene = home(0.0) + car(1.0, name="a") + car(11.0, name="b")
    sound = seconds(heard(tmp_path / "w.wav", held(scene)), 0.2, 0.9)
    left, right = sound * (1, 0), sound * (0, 1)
    near, far = 880 * 2 ** (-1 / 5), 880 * 2 ** (-11 / 5)
    assert strength(sound, near) > 0.1 < strength(sound, far)
    assert strength(sound, 1.2 * near) < 0.01
    assert strength(left, near) > 5 * strength(right, near)
    assert strength(right, far) > 5 * strength(left, far)


def test_voices_without_names_are_as_many(tmp_path: Path):
    scene = home(0.0) + TAt(1.0, 0.0)(PBird()) + TAt(4.0, 0.0)(PBird())
    sound = seconds(heard(tmp_path / "w.wav", held(scene)), 0.2, 0.9)
    assert all(strength(sound, 880 * 2 ** (-far / 5)) > 0.1 for far in (1.0, 4.0))


def test_an_empty_view_is_silent(tmp_path: Path):
    sound = heard(tmp_path / "w.wav", held(EMPTY))
    assert len(sound) == pytest.approx(1.05 * RATE, abs=1)
    assert not sound.any()
    assert not heard(tmp_path / "w.wav", held(home(1.0))).any()


def test_without_a_view_the_file_is_empty_but_valid(tmp_path: Path):
    assert len(heard(tmp_path / "w.wav", {})) == 0


def test_the_file_is_in_simulated_time(tmp_path: Path):
    for dt in (0.001, 1 / 30, 0.7):
        sound = heard(tmp_path / "w.wav", held(car(0.0), 33), dt)
        assert len(sound) == pytest.approx((33 * dt + 0.05) * RATE, abs=1)


def test_frames_that_were_not_shown_hold_the_tone(tmp_path: Path):
    far, near = home(0.0) + car(5.0), home(0.0) + car(5.0, name="a") + car(1.0, name="b")
    sound = heard(tmp_path / "w.wav", {7: far, 17: near, 18: near})
    assert len(sound) == pytest.approx(1.25 * RATE, abs=1)
    assert peak(seconds(sound, 0.1, 1.0)) == pytest.approx(440.0, rel=0.01)
    assert strength(seconds(sound, 0.1, 1.0), 880 * 2 ** (-1 / 5)) < 0.01
    assert strength(seconds(sound, 1.1, 1.2), 880 * 2 ** (-1 / 5)) > 0.1


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.booleans()), max_size=8),
    st.integers(1, 300),
)
def test_nothing_jumps_but_clicks(places: list[tuple[float, float, bool]], count: int):
    """A tone of at most 880 Hz and its octave limits the difference between adjacent samples."""
    synthesis = Synthesis(RATE)
    blocks = []
    for x, y, there in places:
        tones = {"a": Tone(500 + 40 * x, 0.3 + y / 30, 0.3 - y / 30)} if there else {}
        blocks.append(synthesis.sing(tones, count))
    blocks += [synthesis.sing({}, 300) for _ in range(4)]
    sound = np.concatenate(blocks)
    steepest = 2 * math.pi * 880 / RATE * (0.8 + 0.2 * 2) * 0.6 + 0.6 / (0.01 * RATE)
    assert np.abs(np.diff(sound, axis=0, prepend=0.0, append=0.0)).max() < steepest
    assert np.abs(sound).max() <= 0.6


def test_a_setback_clicks_once_and_driving_on_does_not(tmp_path: Path):
    at = [0.0, 0.1, 0.2, 0.1, 0.1, 0.2, 0.3]
    scenes = {frame: home(3.0) + car(x) for frame, x in enumerate(at)}
    device = play(tmp_path / "w.wav", scenes)
    device.close()
    assert clicks(samples(tmp_path / "w.wav")) == pytest.approx([0.3], abs=0.002)


@pytest.mark.parametrize(("angle", "expected"), [(0, 1), (180, 0), (60, 1), (-120, 0)])
def test_behind_is_as_the_voice_was_headed(tmp_path: Path, angle: float, expected: int):
    scenes = {0: car(1.0, angle=angle), 1: car(0.8, angle=77.0), 2: car(0.8, angle=77.0)}
    device = play(tmp_path / "w.wav", {**scenes, 3: EMPTY})
    assert device.report()["clicks"] == expected
    device.close()


def test_a_click_may_last_longer_than_a_frame(tmp_path: Path):
    scenes = {0: car(1.0), **dict.fromkeys(range(1, 60), car(0.5))}
    whole = heard(tmp_path / "a.wav", scenes, dt=0.1)
    parts = heard(tmp_path / "b.wav", scenes, dt=0.001)
    click, begun = seconds(whole, 0.1, 0.12), seconds(parts, 0.001, 0.021)
    assert np.abs(np.diff(click, n=3, axis=0)).max() > 0.1
    assert np.abs(np.diff(click - begun, n=3, axis=0)).max() < 0.02


def test_transformations_move_sounds(tmp_path: Path):
    turned = TTurn(90.0)(TAt(3.0, 0.0)(home(0.0))) + TAt(0.0, 1.0)(car(0.0))
    sound = heard(tmp_path / "w.wav", held(turned))
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(880 * 2 ** (-2 / 5), rel=0.01)


def test_options_name_voices_and_aims(tmp_path: Path):
    bells = TAt(2.0, 0.0)(PBell("x")) + TAt(1.0, 0.0)(PBell("y"))
    scene = car(0.0, name="a") + car(5.0, name="b") + home(0.0) + bells
    sound = heard(tmp_path / "w.wav", held(scene), voice="PCar#a", aim="PBell#x")
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(880 * 2 ** (-2 / 5), rel=0.01)
    assert strength(seconds(sound, 0.2, 0.9), 880 * 2 ** (-3 / 5)) < 0.01
    sound = heard(tmp_path / "w.wav", held(bells + home(0.0)), voice="PBell#y")
    assert peak(seconds(sound, 0.2, 0.9)) == pytest.approx(880 * 2 ** (-1 / 5), rel=0.01)


def test_a_goal_takes_precedence(tmp_path: Path):
    goal = Primitive("PGoal", Disc(0.1))
    device = Sound(str(tmp_path / "w.wav"))
    device.joined(WorldInfo("field", Vocabulary.of(PCar, PHome, TAt, TTurn, goal), 0, 0.1))
    for frame in range(10):
        device.show(View(frame, "ePicture", car(0.0) + home(1.0) + TAt(5.0, 0.0)(goal())))
    device.close()
    assert peak(seconds(samples(tmp_path / "w.wav"), 0.2, 0.9)) == pytest.approx(440, rel=0.01)


def test_views_of_several_types_sound_together(tmp_path: Path):
    device = Sound(str(tmp_path / "w.wav"), draws="ePicture, eOverlay")
    device.joined(world())
    for frame in range(10):
        device.show(View(frame, "eOverlay", home(5.0)))
        device.show(View(frame, "ePicture", car(0.0)))
    device.close()
    assert device.draws == ("ePicture", "eOverlay")
    assert peak(seconds(samples(tmp_path / "w.wav"), 0.2, 0.9)) == pytest.approx(440, rel=0.01)


def test_a_crowd_is_not_louder_than_one(tmp_path: Path):
    crowd = sum((car(i / 10, name=str(i)) for i in range(200)), home(0.0))
    assert 0.1 < np.abs(heard(tmp_path / "w.wav", held(crowd))).max() <= 0.6


def test_the_file_is_whole_after_every_frame(tmp_path: Path):
    device = Sound(str(tmp_path / "w.wav"))
    device.joined(world())
    for frame in range(5):
        device.show(View(frame, "ePicture", car(0.0)))
        assert len(samples(tmp_path / "w.wav")) == frame * 2205
    device.close()


END = """
import os, resource, signal, sys
sys.path[:0] = [{tests!r}]
from test_sound import *
device = play(Path(sys.argv[1]), held(car(0.0) + home(0.0), 20))
{then}
"""


def run(path: Path, then: str) -> subprocess.CompletedProcess[str]:
    code = END.format(tests=str(Path(__file__).parent), then=then)
    command = [sys.executable, "-c", code, str(path)]
    # Python would store cut bytecode of what a process with small files imports.
    environment = {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"}
    env = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, env=env)


def test_the_file_is_whole_after_an_abrupt_end(tmp_path: Path):
    done = run(tmp_path / "w.wav", "os.kill(os.getpid(), signal.SIGKILL)")
    assert done.returncode == -signal.SIGKILL, done.stderr
    sound = samples(tmp_path / "w.wav")
    assert len(sound) == 19 * 2205
    assert peak(seconds(sound, 0.2, 1.8)) == pytest.approx(880.0, rel=0.01)


def test_a_full_disk_is_one_line(tmp_path: Path):
    then = """
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
try:
    [device.show(View(frame, "ePicture", car(0.0))) for frame in range(20, 100)]
except MinervaError as error:
    print(error)
device.close()
"""
    done = run(tmp_path / "w.wav", then)
    assert done.stderr == ""
    assert done.stdout == f"sound: cannot write {tmp_path / 'w.wav'}: File too large;" + (
        " set path to a writable file\n"
    )
    assert len(samples(tmp_path / "w.wav")) > 19 * 2205


def test_a_disk_that_is_full_from_the_start_is_one_line_too(tmp_path: Path):
    then = """
device.close()
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
try:
    play(Path(sys.argv[1]), {})
except MinervaError as error:
    sys.exit(len(str(error).splitlines()))
"""
    done = run(tmp_path / "w.wav", then)
    assert (done.returncode, done.stderr) == (1, "")


def test_a_file_of_four_gigabytes_gets_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("minerva_services.views.sound.sonification._MAX_BYTES", 4 * 2205 * 3)
    assert len(heard(tmp_path / "w.wav", held(car(0.0)))) == 3 * 2205
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "is full" in said


def test_what_is_left_out_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("minerva_services.views.sound.sonification._MAX_BYTES", 4 * 2205 * 3)
    many = sum((car(float(place), name=f"{place}") for place in range(34)), EMPTY)
    device = play(tmp_path / "w.wav", held(many), voice="PCar, PCar#z")
    figures = device.report()
    assert (figures["never shown"], figures["voices left out"]) == ("PCar#z", 2)
    assert figures["seconds left out"] == pytest.approx(0.6)
    device.close()


def test_long_frames_do_not_need_long_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made: list[int] = []
    sing = Synthesis.sing
    monkeypatch.setattr(
        Synthesis, "sing", lambda self, tones, n: made.append(n) or sing(self, tones, n)
    )
    assert len(heard(tmp_path / "w.wav", {0: car(0.0)}, dt=60.0)) == round(60.05 * RATE)
    assert max(made) <= 2**15


def test_the_same_views_make_the_same_file(tmp_path: Path):
    for name in ("a.wav", "b.wav"):
        heard(tmp_path / name, {frame: car(3 - frame, name="é") for frame in range(5)})
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()


def test_its_figures(tmp_path: Path):
    device = play(tmp_path / "deep" / "w.wav", held(car(0.0)))
    assert device.report() == {"sound": str(tmp_path / "deep" / "w.wav"), "clicks": 0}
    assert (device.draws, device.when, device.coupled) == (("ePicture",), "each 1 frames", False)
    device.close()


@pytest.mark.parametrize(
    "options",
    [
        {"path": "w.mp3"}, {"path": ""}, {"path": ".wav"}, {"every": -1}, {"samples": 100},
        {"samples": 10**9}, {"low": 5.0}, {"low": 900.0}, {"high": 9000.0}, {"high": math.nan},
        {"low": math.nan}, {"octave": 0.0}, {"octave": -1.0}, {"octave": math.inf},
        {"octave": math.nan}, {"draws": " , "},
    ],
)  # fmt: skip
def test_options_that_make_no_sense_are_refused(options: dict[str, object]):
    with pytest.raises(MinervaError, match=r"sound: .* expected") as caught:
        Sound(**options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("option", "said"), [("voice", "'PCat'.*PCar"), ("aim", "'PCat'.*PCar")])
def test_a_primitive_that_the_world_does_not_have(tmp_path: Path, option: str, said: str):
    with pytest.raises(MinervaError, match=f"sound: {option} is {said}"):
        Sound(str(tmp_path / "w.wav"), **{option: "PCat"}).joined(world())  # type: ignore[arg-type]


def test_a_world_in_which_nothing_has_a_heading(tmp_path: Path):
    still = WorldInfo("still", Vocabulary.of(PHome), 0, 0.1)
    with pytest.raises(MinervaError, match="sound:voice=PHome; there are PHome"):
        Sound(str(tmp_path / "w.wav")).joined(still)
    with pytest.raises(MinervaError, match="'empty' has no primitives"):
        Sound(str(tmp_path / "w.wav")).joined(WorldInfo("empty", Vocabulary.of(), 0, 0.1))


def test_places_that_cannot_be_written(tmp_path: Path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.wav").mkdir()
    os.mkfifo(tmp_path / "pipe.wav")
    for place in ("file/w.wav", "folder.wav", "pipe.wav"):
        with pytest.raises(MinervaError, match="sound: cannot write") as caught:
            play(tmp_path / place, {})
        assert "\n" not in str(caught.value)


def test_it_starts_only_in_a_world(tmp_path: Path):
    with pytest.raises(MinervaError, match="before the world was joined"):
        Sound(str(tmp_path / "w.wav")).show(View(0, "ePicture", EMPTY))
    Sound(str(tmp_path / "w.wav")).close()
