"""Maps voices to tones: the closer to an aim, the higher the pitch."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from minerva_services.views.sound.sound_geometry import SoundGeometry, Voice

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
