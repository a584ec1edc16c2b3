"""Makes the frames that a folder lacks: one cast for all lights, strip by strip where it is large.

Plan -> tiles -> pixels -> [maker] -> framefiles
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np

from volspec.export.blank import Blanks
from volspec.export.exr import ExrWriter
from volspec.export.framefiles import FrameFiles
from volspec.export.lamps import Lamps
from volspec.export.pixels import Array, Pane, check_viewing, measured
from volspec.export.plan import Plan, Shot
from volspec.export.png import PngWriter
from volspec.export.tiles import Canvas, Caster
from volspec.pipeline import Raycaster
from volspec.raycast import CoefficientImage

Tell = Callable[[str, float], object]
# About how many relit frames a cast takes as long as; for the time left alone.
_FRAMES_A_CAST = 10
# Files that may be open at once, while they grow strip by strip.
_OPEN_FILES = 64
# What sets how bright frames are.
_BRIGHTNESS = "the light's illuminance_lux, or exposure in [viewing]"
# Of the picture that an eye's adaptation is measured in where the whole is never in memory.
_MEASURED_SIDE = 512


class _Progress:
    """The finished share of casts and frames."""

    def __init__(self, casts: Sequence[Sequence[Shot]], tell: Tell) -> None:
        self._tell = tell
        self._total = sum(_FRAMES_A_CAST + len(shots) for shots in casts)
        self._done = 0
        self.casting(0.0)

    def casting(self, share: float) -> None:
        self._tell("export", (self._done + share * _FRAMES_A_CAST) / self._total)

    def done(self, frames: int) -> None:
        """So many frames' worth are finished."""
        self._done += frames
        self.casting(0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Maker:
    """Makes frames.

    Parameters
    ----------
    files : FrameFiles
    """

    files: FrameFiles
    _canvas: Canvas = field(init=False)

    def __post_init__(self) -> None:
        scene = self.files.scene
        channels = len(scene.raycast.groups) * scene.basis.size
        canvas = Canvas(self.files.size, self.files.table.samples, channels)
        object.__setattr__(self, "_canvas", canvas)

    def make(self, plan: Plan, caster_of: Callable[[], Raycaster], tell: Tell) -> tuple[int, int]:
        """How many frames were made, from how many casts.

        Parameters
        ----------
        plan : Plan
        caster_of : callable
            Asked only where something is missing.
        tell : callable
            Called with a step's name and the finished share of it, 0…1.

        Raises
        ------
        ViewingError
            If the eye would have to adapt to what is never there.
        InputError
            If a file cannot be written.
        """
        casts = self._missing(plan)
        if not casts:
            return 0, 0
        scene, table = self.files.scene, self.files.table
        check_viewing(table, scene.relight.viewing.adapting, self._parts)
        notes = {"scene": scene.file.title, "viewing": scene.viewing.model_dump_json()}
        only_cast = table.format == "coefficients"
        if self._parts > 1 and not only_cast:
            casts = [s[i : i + _OPEN_FILES] for s in casts for i in range(0, len(s), _OPEN_FILES)]
        progress = _Progress(casts, tell)
        caster = Caster(caster_of(), scene.raycast, notes)
        if only_cast:
            self._cast(casts, caster, progress)
        else:
            self._relit(casts, caster, progress)
        return sum(len(shots) for shots in casts), len(casts)

    def _missing(self, plan: Plan) -> list[list[Shot]]:
        """The shots to be made, by what they are cast from."""
        missing = self.files.folder.missing()
        casts = (
            [shot for shot in shots if self.files.name(shot) in missing] for shots in plan.casts()
        )
        return [shots for shots in casts if shots]

    @property
    def _parts(self) -> int:
        strips = self._canvas.strips()
        return len(strips) * len(strips[0])

    def _cast(self, casts: list[list[Shot]], caster: Caster, progress: _Progress) -> None:
        for shots in casts:
            seen = shots[0].transfer, shots[0].camera
            image = caster.whole(*seen, self._canvas, progress.casting)
            progress.done(_FRAMES_A_CAST)
            for shot in shots:
                self.files.save(shot, image)
                progress.done(1)

    def _relit(self, casts: list[list[Shot]], caster: Caster, progress: _Progress) -> None:
        blanks = Blanks(_BRIGHTNESS)
        with Lamps() as lamps, self.files.encoders() as encoders:
            for unseen in casts:
                shots = self._measured(unseen, caster)
                seen = shots[0].transfer, shots[0].camera
                images = caster.strips(*seen, self._canvas, progress.casting)
                if self._parts > 1:
                    self._in_strips(images, shots, lamps, blanks)
                    progress.done(_FRAMES_A_CAST + len(shots))
                    continue
                panes = self._panes(next(images))
                progress.done(_FRAMES_A_CAST)
                for shot in shots:
                    notes, pixels = panes[0].image.notes, lamps.row(panes, shot)
                    self._look(shot, pixels, panes, blanks)
                    self.files.put(shot, pixels, notes, encoders)
                    progress.done(1)
        blanks.warn()

    def _measured(self, shots: list[Shot], caster: Caster) -> list[Shot]:
        """What ``adapting = "picture"`` measures, where frames do not hold what it looks at."""
        table = self.files.table
        given = self.files.scene.relight.viewing.adapting == "given"
        if given or not table.has_eye or not (table.transparent or self._parts > 1):
            return shots
        scale = min(1.0, _MEASURED_SIDE / max(self.files.size))
        width, height = (max(1, round(scale * side)) for side in self.files.size)
        small = caster.cast(shots[0].transfer, shots[0].camera, (width, height))
        return [measured(shot, small) for shot in shots]

    def _in_strips(
        self,
        images: Iterator[list[CoefficientImage]],
        shots: Sequence[Shot],
        lamps: Lamps,
        blanks: Blanks,
    ) -> None:
        """Every light of a strip before the next is cast: only one is in memory."""
        with ExitStack() as stack:
            files: list[PngWriter | ExrWriter] = []
            for strip in images:
                panes = self._panes(strip)
                if not files:
                    notes = panes[0].image.notes
                    files = [stack.enter_context(self.files.opened(s, notes)) for s in shots]
                for file, shot in zip(files, shots, strict=True):
                    pixels = lamps.row(panes, shot)
                    self._look(shot, pixels, panes, blanks)
                    file.rows(pixels)

    def _look(self, shot: Shot, pixels: Array, panes: Sequence[Pane], blanks: Blanks) -> None:
        """What no eye sees is for a compositor to brighten."""
        if self.files.table.has_eye:
            alpha = np.hstack([pane.alpha for pane in panes])
            blanks.look(self.files.name(shot), shot.light, pixels, alpha, min(self.files.size))

    def _panes(self, images: Sequence[CoefficientImage]) -> list[Pane]:
        return [Pane.of(image, self.files.table) for image in images]
