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
from posture_opt.explore.other_process import OtherProcess
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.reading import read_measurements
from posture_opt.numerics import Array, Mask, rms_length
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import mapped_colours
from posture_opt.report.parts.parts import sentence
from posture_opt.report.scene.arm_geometry import enlargement
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.report.text.units_text import stated

if TYPE_CHECKING:
    import viser

_ARROW_SHARES = 0.006, 0.014, 0.03  # of the arm's extent: radius of shaft and head, length of the head
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
        self._process, self._one = OtherProcess(), threading.Lock()
        self._data: Measurements | None = None
        self._errors: tuple[Array, Mask] | None = None
        gui, problem = server.gui, asked()
        self._upload: Any = gui.add_upload_button("Open measurements (CSV)", mime_type=".csv,.txt,.dat")
        self._words = gui.add_html("")
        self._scale: Any = gui.add_slider("Arrows, log10", -_DECADES, _DECADES, 0.05, 0.0, visible=False)
        self._colour: Any = gui.add_dropdown("Colour", tuple(_colourings(problem)), visible=False)
        self._row: Any = gui.add_slider("Row", 1, 2, 1, 1, visible=False)
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
            file = Path(folder) / f"measurements{Path(name).suffix[:5]}"
            file.write_bytes(content)
            try:
                self._data = read_measurements(file, self._asked())
            except PostureOptError as error:
                self._say(str(error).replace(str(file), name))
                return
        if self._data.position is None:
            self._data = None
            self._say(
                "the page shows measured positions; of other kinds the reports of calibrate and diagnose have figures"
            )
            return
        self._row.max = max(len(self._data), 2)
        for field in (self._scale, self._colour, self._row, *self._causes):
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
        joints = self._asked().robot.joint_names
        for i, (effect, cause) in enumerate(zip(self._effects, self._causes, strict=True)):
            if effect.get("joint") in joints:
                node = f"/arm/{joints.index(effect['joint']) + 1}/cause_{i}"
                self._server.scene.add_label(node, _named(effect), visible=cause.value)

    def end(self) -> None:
        """Compute nothing more."""
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
            if self._data is None:
                return
            try:
                found = self._process.call(stated_errors, self.problem, self._data)
            except PostureOptError as error:  # an effect that cannot be without its size
                found = error
            if isinstance(found, PostureOptError):
                self._say(str(found))
            elif found is not None:
                errors, kept = -found[0], found[1]  # from the model to what was measured
                self._errors = errors, kept
                away = int(np.count_nonzero(~kept))
                self._say(
                    f"RMS error {stated(rms_length(errors[kept]), 'm')} in {np.count_nonzero(kept)} rows"
                    + (f"; {away} outliers left out" if away else "")
                )
                self._draw()

    def _draw(self) -> None:
        """An arrow at the tool point of every row, from the model to what was measured, enlarged."""
        if self._data is None or self._errors is None:
            return
        errors, kept = self._errors
        problem, q = self._asked(), self._data.q[kept]
        solids = ArmSolids(problem.robot)
        places = np.array([solids.frames(row)[-1][:3, 3] for row in q])
        size = float(np.quantile(np.linalg.norm(errors[kept], axis=1), 0.95))
        factor = enlargement(size, self._extent) * 10.0**self._scale.value
        values = _colourings(problem)[self._colour.value](self._data)[kept]
        colours = mapped_colours(values, float(values.min()), float(values.max())).astype(np.uint8)
        shaft, head, length = (share * self._extent for share in _ARROW_SHARES)
        ends = np.stack([places, places + factor * errors[kept]], axis=1)
        self._server.scene.add_arrows(
            "/measured/errors", ends, colours, shaft_radius=shaft, head_radius=head, head_length=length
        )
        self._scale.label = f"Arrows {factor:.3g} times, log10"

    def _show_row(self) -> None:
        if self._data is not None:
            self._turned(tuple(self._data.q[int(self._row.value) - 1].tolist()))

    def _say(self, words: str) -> None:
        self._words.content = f'<p style="margin:4px 14px;font-size:13px" role="status">{escape(sentence(words))}</p>'


def _colourings(problem: Problem) -> dict[str, Callable[[Measurements], Array]]:
    """By what the arrows are coloured: the value of a joint, the side that it came from, the time."""
    found: dict[str, Callable[[Measurements], Array]] = {}
    for k, name in enumerate(problem.robot.joint_names):
        found[f"value of {name}"] = lambda data, k=k: data.q[:, k]  # type: ignore[misc]
    for k, name in enumerate(problem.robot.joint_names):
        found[f"side of {name}"] = lambda data, k=k: data.approach[:, k]  # type: ignore[misc]
    found["time"] = lambda data: np.zeros(len(data)) if data.time is None else data.time
    return found


def _named(effect: dict[str, Any]) -> str:
    """An effect by its kind and what it is of."""
    of = next((str(effect[key]) for key in ("joint", "gear", "link", "length") if key in effect), "")
    return f"{str(effect['kind']).replace('_', ' ')} {of}".strip()
