"""Renders views to a file: each frame lasts its simulated time, whenever its view arrived."""

from __future__ import annotations

from collections.abc import Mapping

from minerva_bus.grammar.scene import Scene
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import View, WorldInfo
from minerva_services.views.sound.sound_geometry import SoundGeometry, SoundRoles
from minerva_services.views.sound.synthesis import Synthesis
from minerva_services.views.sound.tuning import MAX_VOICES, Tone, Tuning
from minerva_services.views.sound.wavfile import WavFile

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
