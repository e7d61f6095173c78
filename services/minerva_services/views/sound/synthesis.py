"""From tones to samples: voices that never jump, and clicks.

The phase of a voice goes on from block to block whatever becomes of its pitch, and pitch and
loudness glide; so the only clicks that are heard are those that were asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minerva_services.views.sound.tuning import Tone

Samples = NDArray[np.float64]
"""Left and right, -1 to 1; shape (samples, 2)."""

_OVERTONES = ((1, 0.8), (2, 0.2))
"""Multiples of a voice's pitch and their shares: a bare sine is hard to tell where it is."""
_FADE = 0.01
"""Seconds that it takes at least from silence to a tone."""
_SILENT = 1e-5
_CLICK_PITCH, _CLICK_LENGTH, _CLICK_DECAY, _CLICK_LOUDNESS = 3000.0, 0.02, 0.003, 0.4


@dataclass(slots=True)
class _Singer:
    """A voice as it sounds now, and where in its period it is (cycles)."""

    tone: Tone
    cycles: float = 0.0


@dataclass(slots=True)
class _Click:
    """A click that sounds: how loud left and right, and how much of it is over (samples)."""

    left: float
    right: float
    over: int = 0


class Synthesis:
    """Sings tones, block after block, at so many samples a second."""

    def __init__(self, rate: int) -> None:
        self._rate = rate
        self._singers: dict[str, _Singer] = {}
        self._clicks: list[_Click] = []

    def click(self, tone: Tone) -> None:
        """A click at the beginning of the next block, from where a tone is."""
        together = math.hypot(tone.left, tone.right) or 1.0
        self._clicks.append(_Click(tone.left / together, tone.right / together))

    def sing(self, tones: Mapping[str, Tone], count: int) -> Samples:
        """The next `count` samples, in which the voices glide to these tones.

        Voices that are new rise from silence, those that are gone fade away.
        """
        block = np.zeros((count, 2))
        for name, tone in tones.items():
            self._singers.setdefault(name, _Singer(tone.faded()))
        for name, singer in list(self._singers.items()):
            block += self._glide(singer, tones.get(name, singer.tone.faded()), count)
            if name not in tones and max(singer.tone.left, singer.tone.right) < _SILENT:
                del self._singers[name]
        for click in self._clicks:
            block += self._clicked(click, count)
        self._clicks = [one for one in self._clicks if one.over < self._rate * _CLICK_LENGTH]
        return block

    def _glide(self, singer: _Singer, to: Tone, count: int) -> Samples:
        before = singer.tone
        part = min(1.0, count / (_FADE * self._rate))
        left = before.left + (to.left - before.left) * part
        right = before.right + (to.right - before.right) * part
        pitch = np.linspace(before.frequency, to.frequency, count, endpoint=False)
        cycles = singer.cycles + np.cumsum(pitch) / self._rate
        wave = sum(share * np.sin(math.tau * times * cycles) for times, share in _OVERTONES)
        loudness = np.linspace((before.left, before.right), (left, right), count, endpoint=False)
        singer.tone = Tone(to.frequency, left, right)
        singer.cycles = float(cycles[-1]) % 1.0 if count else singer.cycles
        return loudness * np.asarray(wave)[:, None]

    def _clicked(self, click: _Click, count: int) -> Samples:
        seconds = (click.over + np.arange(count)) / self._rate
        click.over += count
        wave = np.cos(math.tau * _CLICK_PITCH * seconds) * np.exp(-seconds / _CLICK_DECAY)
        wave[seconds >= _CLICK_LENGTH] = 0.0
        return _CLICK_LOUDNESS * wave[:, None] * (click.left, click.right)
