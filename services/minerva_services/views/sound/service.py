"""The sound device: a world's views as a stereo WAV file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_file, text_of_path
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types, names_in
from minerva_services.views.sound.sonification import Sonification, Tuning, WavFile, roles

_RATES = range(8_000, 192_001)


class Sound(Device, draws=("ePicture",)):
    """Sonifies worlds that have discs with a heading, or primitives named as voices.

    Each voice is a tone: the closer to the nearest aim, the higher; panned by its position in the
    picture. It clicks when it is set back against its heading, which indicates a collision. The
    file is in simulated time from the first view on; gaps between views hold the previous tones.

    Args:
        path: the output file; its folder is created if missing.
        every: frames between views; 0 leaves requesting them to a generator.
        draws: visual event types, comma-separated; they sound together.
        voice: primitives that sound, comma-separated, as PRobot, or PRobot#r1 for a named one;
          default: all discs with a heading.
        aim: aims of the voices, likewise; default: PGoal or, if the world has no such primitive,
          all discs without a heading.
        high: pitch at an aim in Hz.
        low: lowest pitch in Hz, also without an aim.
        octave: distance in metres over which the pitch falls by an octave.
        samples: sample rate, 8000 to 192000 Hz.

    """

    def __init__(
        self,
        path: str = "minerva.wav",
        every: int = 1,
        draws: str = "ePicture",
        voice: str = "",
        aim: str = "",
        high: float = 880.0,
        low: float = 110.0,
        octave: float = 5.0,
        samples: int = 22050,
    ) -> None:
        if every < 0:
            raise MisuseError(f"sound: every is {every}; expected a number of frames from 0")
        if samples not in _RATES:
            raise MisuseError(f"sound: samples is {samples}; expected 8000 to 192000 per second")
        self.when = f"each {every} frames" if every else ""
        self.draws = event_types("sound", draws)
        self._path = Path(path)
        check_ending(self._path, (".wav",), "sound")
        self.writes = (self._path,)
        # Also before the world starts, which may take long.
        check_file(self._path, "sound")
        self._named = names_in(voice), names_in(aim)
        self._tuning = _tuning(high, low, octave, samples)
        self._samples = samples
        self._sonification: Sonification | None = None

    def check(self, world: WorldInfo) -> None:
        self._roles = roles(world, *self._named)

    def joined(self, world: WorldInfo) -> None:
        self.check(world)
        file = WavFile(self._path, self._samples)
        self._sonification = Sonification(world, self._roles, self._tuning, file)

    def show(self, view: View) -> None:
        """φ of the view. Raises MisuseError if the file cannot be written."""
        if self._sonification is None:
            raise MisuseError("sound: a view arrived before the world was joined")
        self._sonification.add(view)

    def report(self) -> Mapping[str, bool | int | float | str]:
        if self._sonification is None:
            return {}
        sound = text_of_path(self._path)
        return {"sound": sound, "clicks": self._sonification.clicks, **self._sonification.left_out}

    def close(self) -> None:
        if self._sonification is not None:
            self._sonification.end()
            self._sonification = None


def _tuning(high: float, low: float, octave: float, samples: int) -> Tuning:
    # The overtone at twice the pitch must stay below half the sample rate (Nyquist).
    if not 20.0 <= low <= high <= samples / 4:
        raise MisuseError(
            f"sound: low is {low:g} and high is {high:g}; expected 20 <= low <= high <="
            f" {samples // 4} Hz, a quarter of the samples per second"
        )
    if not 0.0 < octave < math.inf:
        raise MisuseError(f"sound: octave is {octave:g}; expected metres above 0")
    return Tuning(float(high), float(low), float(octave))
