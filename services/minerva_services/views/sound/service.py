"""The sound device: a world's views as a stereo WAV file."""

from __future__ import annotations

import math
from collections.abc import Mapping

from minerva_bus.errors import MisuseError
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types, names_in
from minerva_services.views.sound.performance import Performance
from minerva_services.views.sound.roles import roles
from minerva_services.views.sound.tuning import Tuning
from minerva_services.views.sound.wavfile import WavFile, wav_path

_RATES = range(8_000, 192_001)


class Sound(Device, draws=("ePicture",)):
    """Makes every world audible that has discs with a heading, or primitives named as voices.

    Each voice is a tone: the nearer to the nearest aim the higher, left or right as it stands in
    what the world draws. It clicks when it is set back against its heading, which is how a
    collision shows. The file is in simulated time, from the first view on; what was not shown is
    filled with the tones from before.

    Args:
        path: where the sound goes; the folder is made where there is none.
        every: frames between views; 0 leaves it to a generator to ask for them.
        draws: visual event types, separated by commas; they are heard together.
        voice: primitives that sound, separated by commas, as PRobot, or PRobot#r1 for one that is
            named so; none: all discs with a heading.
        aim: primitives that voices are after, likewise; none: PGoal or, where the world has
            no such primitive, all discs without a heading.
        high: Hz, the pitch at an aim.
        low: Hz, the deepest pitch, also where there is no aim.
        octave: metres in which the pitch falls an octave.
        samples: in a second, 8000 to 192000.

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
            raise MisuseError(f"sound: samples is {samples}; expected 8000 to 192000 in a second")
        self.every = every
        self.draws = event_types("sound", draws)
        self._path = wav_path(path)
        self._named = names_in(voice), names_in(aim)
        self._tuning = _tuning(high, low, octave, samples)
        self._samples = samples
        self._playing: Performance | None = None

    def joined(self, world: WorldInfo) -> None:
        chosen = roles(world, *self._named)
        file = WavFile(self._path, self._samples)
        self._playing = Performance(world, chosen, self._tuning, file)

    def show(self, view: View) -> None:
        """φ of the view. Raises MisuseError where the file cannot be written."""
        if self._playing is None:
            raise MisuseError("sound: a view came before the world was joined")
        self._playing.hear(view)

    def report(self) -> Mapping[str, bool | int | float | str]:
        if self._playing is None:
            return {}
        return {"sound": str(self._path), "clicks": self._playing.clicks}

    def close(self) -> None:
        if self._playing is not None:
            self._playing.end()
            self._playing = None


def _tuning(high: float, low: float, octave: float, samples: int) -> Tuning:
    if not 20.0 <= low <= high <= samples / 4:
        raise MisuseError(
            f"sound: low is {low:g} and high is {high:g}; expected 20 <= low <= high <="
            f" {samples // 4} Hz, a quarter of the samples in a second"
        )
    if not 0.0 < octave < math.inf:
        raise MisuseError(f"sound: octave is {octave:g}; expected metres above 0")
    return Tuning(float(high), float(low), float(octave))
