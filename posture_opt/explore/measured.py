"""``Measured``: measurements on the page, with the errors that the model leaves, and its causes switched on and off."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.calibration.calibrate import stated_errors
from posture_opt.errors import PostureOptError
from posture_opt.explore.measured_marks import ERROR_COLOUR, Marks, are_vectors, colourings
from posture_opt.explore.other_process import OtherProcess
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.reading import read_measurements
from posture_opt.numerics import Array, Mask, rms_length
from posture_opt.problem.problem import Problem
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.statements.notation import sentence, stated

if TYPE_CHECKING:
    import viser

_DECADES = 1.0  # the slider of the arrows goes so far to either side of the round factor


class Measured:
    """The measurements, their errors and the effects of the model.

    Args:
        server: of the page; the controls are put where its panel is at the moment.
        asked: the problem that is asked at the moment.
        extent: of the arm [m].
        turned: called with the posture (n,) [rad or m] of a row that is to be shown.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        asked: Callable[[], Problem],
        extent: float,
        turned: Callable[[tuple[float, ...]], None],
    ) -> None:
        self._server, self._asked, self._extent, self._turned = server, asked, extent, turned
        self._process, self._one, self._ended = OtherProcess(), threading.Lock(), threading.Event()
        self._data: Measurements | None = None
        self._names = " ", " "  # what an uploaded file is called here, and where it comes from
        self._errors: tuple[Array, Mask] | None = None
        gui, problem = server.gui, asked()
        self._upload: Any = gui.add_upload_button("Open measurements (CSV)", mime_type=".csv,.txt,.dat")
        self._words = gui.add_html("")
        self._scale: Any = gui.add_slider("Arrows, log10", -_DECADES, _DECADES, 0.05, 0.0, visible=False)
        self._colour: Any = gui.add_dropdown("Colour", (ERROR_COLOUR,), visible=False)
        self._row: Any = gui.add_slider("Row", 1, 2, 1, 1, visible=False)
        self._row_words = gui.add_html("")
        self._effects = problem.to_dict().get("effects") or []
        self._causes = [gui.add_checkbox(_named(effect), True, visible=False) for effect in self._effects]
        self._upload.on_upload(lambda _: self.read(self._upload.value.name, self._upload.value.content))
        for cause in self._causes:
            cause.on_update(lambda event: self._switched() if event.client is not None else None)
        for field in (self._scale, self._colour):
            field.on_update(lambda _: self._draw())
        self._row.on_update(lambda event: self._show_row() if event.client is not None else None)

    def read(self, name: str, content: bytes) -> None:
        """The measurements of a file that a browser sent, by the checks of any other file."""
        with TemporaryDirectory() as folder:
            file = Path(folder) / "measurements.csv"  # a name that a browser sent is not one for this machine
            file.write_bytes(content)
            self._names = str(file), name
            try:
                data = read_measurements(file, self._asked())
            except PostureOptError as error:
                self._say(str(error))
                return
        self.show(data)

    def show(self, data: Measurements) -> None:
        """Measurements with the errors that the model leaves."""
        self._data, self._errors = data, None
        self._row.max, self._row.value = max(len(data), 2), 1
        vectors = are_vectors(data)
        self._colour.options = tuple(colourings(self._asked(), data))
        self._colour.value = self._colour.options[-1 if not vectors else 0]
        self._scale.visible = vectors
        for field in (self._colour, self._row, *self._causes):
            field.visible = True
        self._mark()
        self.compute()

    def compute(self) -> None:
        """The errors of the model with the causes that are switched on, while the page goes on."""
        threading.Thread(target=self._run, daemon=True).start()

    def _switched(self) -> None:
        self._mark()
        self.compute()

    def _mark(self) -> None:
        """The causes that are switched on, by their names at their joints."""
        joints = {joint.name: joint for joint in ArmSolids(self._asked().robot).joints}
        for i, (effect, cause) in enumerate(zip(self._effects, self._causes, strict=True)):
            if effect.get("joint") in joints:
                joint = joints[effect["joint"]]
                node, place = f"/arm/{joint.frame}/cause_{i}", tuple(joint.middle)
                self._server.scene.add_label(node, _named(effect), position=place, visible=cause.value)

    def end(self) -> None:
        """Compute nothing more."""
        self._ended.set()
        self._process.stop()

    @property
    def problem(self) -> Problem:
        """What is asked, with the sizes of those causes that are switched on."""
        problem = self._asked()
        if all(cause.value for cause in self._causes):
            return problem
        # Without its size, but still there: the covariance of a fitted arm names its parameters.
        none = [{**effect, "estimate": dict.fromkeys(effect.get("estimate") or {}, 0)} for effect in self._effects]
        chosen = zip(self._effects, none, self._causes, strict=True)
        return problem.replace(effects=[effect if cause.value else off for effect, off, cause in chosen])

    def _run(self) -> None:
        with self._one:
            data = self._data
            if data is None:
                return
            try:
                found = self._process.call(stated_errors, self.problem, data)
            except PostureOptError as error:  # an effect that cannot be without its size
                found = error
            if self._ended.is_set():
                return
            if isinstance(found, PostureOptError):
                self._say(str(found))
            elif found is not None and data is self._data:
                errors, kept = -found[0], found[1]  # from the model to what was measured
                self._errors = errors, kept
                count, away = int(np.count_nonzero(kept)), int(np.count_nonzero(~kept))
                self._say(
                    f"RMS {data.kind.error_words} {stated(rms_length(errors[kept]), 'm')} in {count} rows"
                    + (f"; {away} outliers left out" if away else "")
                )
                self._draw()
                self._row_words.content = self._of_row()

    def _draw(self) -> None:
        """The errors at the tool points of their rows."""
        data, errors = self._data, self._errors
        if data is None or errors is None:
            return
        values = colourings(self._asked(), data)[self._colour.value](errors[0])
        marks = Marks(self._asked(), data, errors, values, self._extent, 10.0**self._scale.value)
        marks.draw(self._server)
        self._scale.label = f"Arrows {marks.factor:.3g} times, log10"

    def _of_row(self) -> str:
        """The error of the chosen row, in words."""
        data, errors = self._data, self._errors
        if data is None or errors is None:
            return ""
        row = min(int(self._row.value), len(data)) - 1
        words = f"Row {row + 1}: {data.kind.error_words} {stated(float(np.linalg.norm(errors[0][row])), 'm')}"
        return _line(words + ("." if errors[1][row] else ", an outlier."))

    def _show_row(self) -> None:
        if self._data is not None:
            self._turned(tuple(self._data.q[min(int(self._row.value), len(self._data)) - 1].tolist()))
            self._row_words.content = self._of_row()

    def _say(self, words: str) -> None:
        self._words.content = _line(sentence(words.replace(*self._names)))


def _named(effect: dict[str, Any]) -> str:
    """An effect by its kind and what it is of."""
    of = next((str(effect[key]) for key in ("joint", "gear", "link", "length") if key in effect), "")
    return f"{str(effect['kind']).replace('_', ' ')} {of}".strip()


def _line(words: str) -> str:
    return f'<p style="margin:4px 14px;font-size:13px" role="status">{escape(words)}</p>'
