"""Renders views to a WAV file: each frame lasts its simulated time, whenever its view arrived.

The geometric system of sounds says which figures of a string are voices, and which are their aims:

α    a voice sounds at its position; an aim affects the voices near it
β δ  transformations move sources, as in any planar geometry

The closer a voice is to an aim, the higher is its tone. Its phase continues from block to block and
its pitch and loudness glide, so the only audible clicks are intended ones. The file is valid at any
time. Python's `wave` can read it, but its writer raises again on deletion after the disk was full,
so it is not used here.
"""

from __future__ import annotations

import contextlib
import math
import struct
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import MARK, check_file
from minerva_bus.grammar.appearance import Disc
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import BoundingGeometry
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import View, WorldInfo

_BLOCK_SAMPLES = 2**15
"""Samples rendered at a time, regardless of a frame's duration."""
_FADE_SECONDS = 0.05
"""Duration of the final fade in seconds."""


class Sonification:
    """The sound of a world, from its first view.

    A frame is written when the next one arrives: only then are all its views complete and its
    duration known.
    """

    def __init__(self, world: WorldInfo, roles: SoundRoles, tuning: Tuning, file: WavFile) -> None:
        self._world = world
        self._roles = roles
        self._tuning = tuning
        self._file = file
        self._synthesis = Synthesis(file.rate)
        self._views: dict[str, Scene] = {}
        self._first = self._now = -1
        self._written = 0
        self._poses: dict[str, Pose] = {}
        self._awaited = {name for name in roles.voices | roles.aims if "#" in name}
        self._most = 0
        self.clicks = 0

    @property
    def left_out(self) -> dict[str, str | float]:
        """What is not in the sound, for people: figures, voices and seconds."""
        figures = {
            "never shown": ", ".join(sorted(self._awaited)),
            "voices left out": max(0, self._most - MAX_VOICES),
            "seconds left out": self._file.left_out / self._file.rate,
        }
        return {what: figure for what, figure in figures.items() if figure}

    def add(self, view: View) -> None:
        """Add a view, and write everything before its frame."""
        if not self._views:
            self._first = self._now = view.frame
        elif view.frame > self._now:
            self._play(view.frame)
            self._now = view.frame
        self._views[view.event_type] = view.scene

    def end(self) -> None:
        """Write the last frame and fade out."""
        if self._views:
            self._play(self._now + 1)
            self._write(round(_FADE_SECONDS * self._file.rate), {})
        self._file.close()

    def _play(self, until: int) -> None:
        """Glide to the current tones during one frame, then hold them until the next."""
        tones = self._tones()
        for frame in (self._now + 1, until):
            # Counted from the first frame, so that roundings do not add up.
            end = round((frame - self._first) * self._world.dt * self._file.rate)
            self._write(end - self._written, tones)
            self._written = end

    def _tones(self) -> dict[str, Tone]:
        """The current tones; a voice that was set back clicks."""
        sounds = SoundGeometry(self._world.vocabulary, self._roles)
        for scene in self._views.values():
            interpret(scene, sounds)
        tones, voices = self._tuning.tones(sounds), sounds.voices()
        self._awaited -= sounds.names
        self._most = max(self._most, len(voices))
        for name, tone in tones.items():
            before = self._poses.get(name)
            if before is not None and voices[name].is_set_back_from(before):
                self._synthesis.click(tone)
                self.clicks += 1
        self._poses = {name: voice.at for name, voice in voices.items()}
        return tones

    def _write(self, count: int, tones: Mapping[str, Tone]) -> None:
        while count > 0:
            size = min(count, _BLOCK_SAMPLES)
            self._file.write(self._synthesis.sing(tones, size))
            count -= size


GOAL = "PGoal"
"""Default primitive of an agent's aim, in the robot's world and elsewhere."""


@dataclass(frozen=True, slots=True)
class SoundRoles:
    """Voices and aims: all figures of a symbol, as PRobot, or one by name, as PRobot#r1."""

    voices: frozenset[str]
    aims: frozenset[str]


def name_of(figure: FigureNode) -> str:
    """SYMBOL#NAME for a figure with the parameter `name`, otherwise its symbol."""
    name = figure.parameters.get("name")
    return f"{figure.symbol}#{name}" if isinstance(name, str) else figure.symbol


def plays(figure: FigureNode, part: Collection[str]) -> bool:
    """True if a figure belongs to a role."""
    return figure.symbol in part or name_of(figure) in part


def roles(world: WorldInfo, voices: Collection[str], aims: Collection[str]) -> SoundRoles:
    """The roles for these names.

    Without names, voices are all discs with a heading, and the aim is PGoal or, if the world has
    none, every disc without a heading.

    Raises MisuseError for unknown names, and if nothing would sound.
    """
    named = _known(world, "voice", voices) or _discs(world, heading=True)
    if not named:
        discs = sorted(_discs(world, heading=False) or world.vocabulary.primitives)
        raise MisuseError(
            f"no disc of the world {world.world!r} has a heading; choose what sounds with"
            f" the option voice, such as --view sound:voice={discs[0]}; there are"
            f" {', '.join(discs)}"
            if discs
            else f"the world {world.world!r} has no primitives that could sound"
        )
    aimed = _known(world, "aim", aims) or _goals(world) or _discs(world, heading=False)
    # A figure cannot be the aim of its own voice: its distance would always be 0.
    return SoundRoles(named, aimed - named)


def _goals(world: WorldInfo) -> frozenset[str]:
    return frozenset({GOAL} & world.vocabulary.primitives.keys())


def _known(world: WorldInfo, option: str, names: Collection[str]) -> frozenset[str]:
    known = world.vocabulary.primitives
    for name in names:
        symbol, is_named, _ = name.partition("#")
        if symbol not in known:
            hint = nearest(symbol, list(known), f"it has {', '.join(sorted(known))}")
            raise MisuseError(
                f"sound: {option} is {name!r}, but the world {world.world!r} has no such"
                f" primitive{hint}"
            )
        if is_named and "name" not in known[symbol].fields.names:
            raise MisuseError(
                f"sound: {option} is {name!r}, but {symbol} has no parameter `name`; use {symbol}"
            )
    return frozenset(names)


def _discs(world: WorldInfo, heading: bool) -> frozenset[str]:
    return frozenset(
        name
        for name, primitive in world.vocabulary.primitives.items()
        if isinstance(primitive.shape, Disc) and primitive.shape.heading is heading
    )


_MIN_SETBACK = 0.005
"""Minimum setback in metres; less may be rounding."""


@dataclass(frozen=True, slots=True)
class Voice:
    """A figure that sounds, and its distance to the nearest aim (m; inf without one)."""

    at: Pose
    distance: float

    def is_set_back_from(self, before: Pose) -> bool:
        """True if it is behind its previous position.

        A figure with a heading drives forward. It moves behind itself only when evolution takes
        back part of a move: that is how a collision shows in a view.
        """
        ahead = math.radians(before.angle)
        along = math.cos(ahead) * (self.at.x - before.x) + math.sin(ahead) * (self.at.y - before.y)
        return along < -_MIN_SETBACK


class SoundGeometry(BoundingGeometry):
    """Collects the voices of a string of L(E) and their positions."""

    def __init__(self, vocabulary: Vocabulary, roles: SoundRoles) -> None:
        super().__init__(vocabulary)
        self._roles = roles
        self._poses: dict[str, Pose] = {}
        self._aims: list[tuple[float, float]] = []
        self.names = set[str]()
        """Symbols and names of all figures."""

    def other_figure(self, figure: FigureNode) -> None:
        """α: a primitive may sound without being drawn."""
        self.names.add(name_of(figure))
        if plays(figure, self._roles.voices):
            self._poses[self._name(figure)] = self.pose
        elif plays(figure, self._roles.aims):
            self._aims.append((self.pose.x, self.pose.y))
        # For the bounds, within which voices are panned.
        super().other_figure(figure)

    def voices(self) -> dict[str, Voice]:
        """The voices of the string by name, in order."""
        return {name: Voice(at, self._distance(at)) for name, at in self._poses.items()}

    def side(self, at: Pose) -> float:
        """Horizontal position: 0 at the left edge of everything drawn, 1 at the right edge."""
        if self.bounds is None or self.bounds.right <= self.bounds.left:
            return 0.5
        width = self.bounds.right - self.bounds.left
        return min(1.0, max(0.0, (at.x - self.bounds.left) / width))

    def _name(self, figure: FigureNode) -> str:
        """The figure's name, or its number among the voices."""
        name = name_of(figure)
        return name if "#" in name else f"{name}#{len(self._poses)}"

    def _distance(self, at: Pose) -> float:
        return min((math.dist((at.x, at.y), aim) for aim in self._aims), default=math.inf)


MAX_LOUDNESS = 0.6
"""Total loudness of all voices as a fraction of full scale; the rest is for clicks."""
MAX_VOICES = 32


@dataclass(frozen=True, slots=True)
class Tone:
    """A steady tone: pitch in Hz, and loudness left and right, 0 to 1."""

    frequency: float
    left: float
    right: float

    def faded(self) -> Tone:
        """The same tone at zero loudness."""
        return replace(self, left=0.0, right=0.0)


@dataclass(frozen=True, slots=True)
class Tuning:
    """Highest and lowest pitch in Hz, and the distance in metres per octave."""

    high: float
    low: float
    octave: float

    def pitch(self, distance: float) -> float:
        """Pitch in Hz at a distance in metres from the nearest aim."""
        return max(self.low, self.high * 2.0 ** (-distance / self.octave))

    def tones(self, sounds: SoundGeometry) -> dict[str, Tone]:
        """The tones of a string's voices by name, limited to the first MAX_VOICES."""
        voices = list(sounds.voices().items())[:MAX_VOICES]
        return {
            # Loudness is shared, so that voices in phase do not exceed the full scale.
            name: self._tone(voice, sounds.side(voice.at), MAX_LOUDNESS / len(voices))
            for name, voice in voices
        }

    def _tone(self, voice: Voice, side: float, loudness: float) -> Tone:
        """Constant-power panning: the squares of left and right add up to the same."""
        left, right = math.cos(side * math.pi / 2), math.sin(side * math.pi / 2)
        return Tone(self.pitch(voice.distance), loudness * left, loudness * right)


Samples = NDArray[np.float64]
"""Left and right channel, -1 to 1; shape (samples, 2)."""

_OVERTONES = ((1, 0.8), (2, 0.2))
"""Multiples of a voice's pitch and their shares: a pure sine is hard to localise."""
_GLIDE_SECONDS = 0.01
"""Minimum fade time between silence and a tone, in seconds."""
# Loudness below which a voice that is no longer shown is removed.
_SILENCE = 1e-5
# In Hz, seconds, seconds, and as a fraction of full scale.
_CLICK_PITCH, _CLICK_LENGTH, _CLICK_DECAY, _CLICK_LOUDNESS = 3000.0, 0.02, 0.003, 0.4


@dataclass(slots=True)
class _Singer:
    """A voice's current tone and its phase (cycles)."""

    tone: Tone
    cycles: float = 0.0


@dataclass(slots=True)
class _Click:
    """A click in progress: loudness left and right, and elapsed samples."""

    left: float
    right: float
    over: int = 0


class Synthesis:
    """Renders tones block by block at a sample rate."""

    def __init__(self, rate: int) -> None:
        self._rate = rate
        self._singers: dict[str, _Singer] = {}
        self._clicks: list[_Click] = []

    def click(self, tone: Tone) -> None:
        """Start a click at the next block, panned like a tone."""
        together = math.hypot(tone.left, tone.right) or 1.0
        self._clicks.append(_Click(tone.left / together, tone.right / together))

    def sing(self, tones: Mapping[str, Tone], count: int) -> Samples:
        """The next `count` samples, in which voices glide to these tones.

        New voices fade in, missing ones fade out.
        """
        block = np.zeros((count, 2))
        for name, tone in tones.items():
            self._singers.setdefault(name, _Singer(tone.faded()))
        for name, singer in list(self._singers.items()):
            block += self._glide(singer, tones.get(name, singer.tone.faded()), count)
            if name not in tones and max(singer.tone.left, singer.tone.right) < _SILENCE:
                del self._singers[name]
        for click in self._clicks:
            block += self._clicked(click, count)
        self._clicks = [click for click in self._clicks if click.over < self._rate * _CLICK_LENGTH]
        return block

    def _glide(self, singer: _Singer, to: Tone, count: int) -> Samples:
        before = singer.tone
        # A block shorter than the fade changes the loudness in part only.
        part = min(1.0, count / (_GLIDE_SECONDS * self._rate))
        left = before.left + (to.left - before.left) * part
        right = before.right + (to.right - before.right) * part
        # The phase is the integral of the pitch, so gliding causes no discontinuity.
        pitch = np.linspace(before.frequency, to.frequency, count, endpoint=False)
        cycles = singer.cycles + np.cumsum(pitch) / self._rate
        wave = sum(share * np.sin(math.tau * times * cycles) for times, share in _OVERTONES)
        loudness = np.linspace((before.left, before.right), (left, right), count, endpoint=False)
        singer.tone = Tone(to.frequency, left, right)
        # Wrapped, or the phase would lose precision over hours.
        singer.cycles = float(cycles[-1]) % 1.0 if count else singer.cycles
        return loudness * np.asarray(wave)[:, None]

    def _clicked(self, click: _Click, count: int) -> Samples:
        seconds = (click.over + np.arange(count)) / self._rate
        click.over += count
        wave = np.cos(math.tau * _CLICK_PITCH * seconds) * np.exp(-seconds / _CLICK_DECAY)
        wave[seconds >= _CLICK_LENGTH] = 0.0
        return _CLICK_LOUDNESS * wave[:, None] * (click.left, click.right)


_CHANNELS, _WIDTH, _PCM = 2, 2, 1
_HEADER = struct.Struct("<4sI4s4sIHHIIHH")
_DATA = struct.Struct("<4sI")
_TEXT = MARK.encode() + b"\0"  # 20 bytes; chunks have even lengths
_INFO = struct.pack("<4sI4s4sI", b"LIST", 12 + len(_TEXT), b"INFO", b"ISFT", len(_TEXT)) + _TEXT
"""The program's mark as a LIST chunk of type INFO."""
_MAX_BYTES = 2**32 - 2**16
"""Maximum size in bytes: lengths in a WAV file have 32 bits."""


class WavFile:
    """A 16-bit stereo file.

    Raises MisuseError if it cannot be written.
    """

    def __init__(self, path: Path, rate: int) -> None:
        self.path, self.rate = path, rate
        self._bytes = 0
        self._is_full = False
        self.left_out = 0
        """Samples that were not written, because the file was full."""
        check_file(path, "sound")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Unbuffered, so that written samples survive any end of the process.
            self._file = path.open("wb", buffering=0)
            self._put(0, self._header())
        except OSError as error:
            raise self._unwritable(error.strerror or "") from None

    def write(self, block: Samples) -> None:
        """Append samples, then update the header; ignored once the file is full."""
        if self._is_full:
            self.left_out += len(block)
            return
        data = np.rint(np.clip(block, -1.0, 1.0) * 32767).astype("<i2").tobytes()
        if self._bytes + len(data) > _MAX_BYTES:
            self._is_full, self.left_out = True, len(block)
            sys.stderr.write(f"sound: {self.path} is full (4 GiB); further samples are dropped\n")
            return
        try:
            self._put(_DATA_OFFSET + self._bytes, data)
            self._bytes += len(data)
            # After the samples: a process that dies in between leaves a valid, shorter file.
            self._put(0, self._header())
        except OSError as error:
            self._is_full = True
            raise self._unwritable(error.strerror or "") from None

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _put(self, at: int, data: bytes) -> None:
        self._file.seek(at)
        while data:
            # An unbuffered write may be partial.
            data = data[self._file.write(data) :]

    def _header(self) -> bytes:
        frame = _CHANNELS * _WIDTH
        about = 16, _PCM, _CHANNELS, self.rate, self.rate * frame, frame, 8 * _WIDTH
        length = _DATA_OFFSET - 8 + self._bytes
        riff = _HEADER.pack(b"RIFF", length, b"WAVE", b"fmt ", *about)
        return riff + _INFO + _DATA.pack(b"data", self._bytes)

    def _unwritable(self, reason: str) -> MisuseError:
        return MisuseError(
            f"sound: cannot write {self.path}: {reason}; set path to a writable file"
        )


_DATA_OFFSET = _HEADER.size + len(_INFO) + _DATA.size
"""Offset of the first sample in bytes."""
