"""Synthesis of tones without discontinuities, and of clicks.

A voice's phase continues from block to block and its pitch and loudness glide, so the only audible
clicks are intended ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minerva_services.views.sound.tuning import Tone

Samples = NDArray[np.float64]
"""Left and right channel, -1 to 1; shape (samples, 2)."""

_OVERTONES = ((1, 0.8), (2, 0.2))
"""Multiples of a voice's pitch and their shares: a pure sine is hard to localise."""
_FADE_SECONDS = 0.01
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
        part = min(1.0, count / (_FADE_SECONDS * self._rate))
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
