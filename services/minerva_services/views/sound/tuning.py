"""From what is heard to tones: the nearer to an aim, the higher."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from minerva_services.views.sound.hearing import Hearing, Voice

LOUDEST = 0.6
"""Of full scale, for all voices together; the rest is for clicks."""
MOST_VOICES = 32


@dataclass(frozen=True, slots=True)
class Tone:
    """A steady tone: its pitch in Hz, and how loud it is left and right, 0 to 1."""

    frequency: float
    left: float
    right: float

    def faded(self) -> Tone:
        """The same, unheard."""
        return replace(self, left=0.0, right=0.0)


@dataclass(frozen=True, slots=True)
class Tuning:
    """The pitch at an aim and the deepest one in Hz, and the metres in which it falls an octave."""

    high: float
    low: float
    octave: float

    def pitch(self, distance: float) -> float:
        """The pitch in Hz at a distance in metres from the nearest aim."""
        return max(self.low, self.high * 2.0 ** (-distance / self.octave))

    def tones(self, heard: Hearing) -> dict[str, Tone]:
        """The tones of a string's voices by name; of a crowd, the first MOST_VOICES are heard."""
        voices = list(heard.voices().items())[:MOST_VOICES]
        return {
            name: self._tone(voice, heard.side(voice.at), LOUDEST / len(voices))
            for name, voice in voices
        }

    def _tone(self, voice: Voice, side: float, loudness: float) -> Tone:
        """As loud in the middle as at the sides: the squares of left and right add up."""
        left, right = math.cos(side * math.pi / 2), math.sin(side * math.pi / 2)
        return Tone(self.pitch(voice.distance), loudness * left, loudness * right)
