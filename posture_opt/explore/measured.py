"""``Measured``: measurements on the page with the errors that the model leaves; its causes can be switched off."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from posture_opt.calibration.calibrate import stated_errors
from posture_opt.errors import PostureOptError
from posture_opt.explore.drawing import add_points, line, on_user
from posture_opt.explore.other_process import OtherProcess
from posture_opt.measurements.measurements import Measurements
from posture_opt.measurements.reading import read_measurements
from posture_opt.numerics import Array, Mask, rms_length
from posture_opt.problem.problem import Problem
from posture_opt.report.page.colours import mapped_colours
from posture_opt.report.scene.arm_geometry import enlargement
from posture_opt.report.scene.arm_solids import ArmSolids
from posture_opt.statements.notation import sentence, stated

if TYPE_CHECKING:
    import viser


def colourings(problem: Problem, data: Measurements) -> dict[str, Array | None]:
    """What is shown in colours -> its values (N,): joints, sides they came from, time; None for the error itself."""
    names = problem.robot.joint_names
    found: dict[str, Array | None] = {f"value of {name}": data.q[:, k] for k, name in enumerate(names)}
    found |= {f"side of {name}": data.approach[:, k] for k, name in enumerate(names)}
    return {**found, **({} if data.time is None else {"time": data.time}), "error": None}


class Measured:
    """The measurements, their errors and the effects of the model.

    Args:
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
        self._scale: Any = gui.add_slider("Arrows, log10", -1.0, 1.0, 0.05, 0.0, visible=False)
        self._colour: Any = gui.add_dropdown("Colour", ("error",), visible=False)
        self._row: Any = gui.add_slider("Row", 1, 2, 1, 1, visible=False)
        self._row_words = gui.add_html("")
        self._effects = problem.to_dict().get("effects") or []
        self._causes = [gui.add_checkbox(_named(effect), True, visible=False) for effect in self._effects]
        self._upload.on_upload(lambda _: self.read(self._upload.value.name, self._upload.value.content))
        for cause in self._causes:
            on_user(cause, self._computed_again)
        for field in (self._scale, self._colour):
            field.on_update(lambda _: self._draw())
        on_user(self._row, self._show_row)

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
        self._scale.visible = _are_vectors(data)
        self._colour.options = tuple(colourings(self._asked(), data))
        self._colour.value = self._colour.options[0 if _are_vectors(data) else -1]
        for field in (self._colour, self._row, *self._causes):
            field.visible = True
        self._computed_again()

    def compute(self) -> None:
        """The errors of the model with the causes that are switched on, while the page goes on."""
        threading.Thread(target=self._run, daemon=True).start()

    def _computed_again(self) -> None:
        """Mark the causes that are switched on at their joints, and compute the errors with them."""
        joints = {joint.name: joint for joint in ArmSolids(self._asked().robot).joints}
        for i, (effect, cause) in enumerate(zip(self._effects, self._causes, strict=True)):
            if effect.get("joint") in joints:
                joint = joints[effect["joint"]]
                node, place = f"/arm/{joint.frame}/cause_{i}", tuple(joint.middle)
                self._server.scene.add_label(node, _named(effect), position=place, visible=cause.value)
        self.compute()

    def end(self) -> None:
        """Compute nothing more."""
        self._ended.set()
        self._process.end()

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
                words = f"RMS {data.kind.error_words} {stated(rms_length(errors[kept]), 'm')} in {kept.sum()} rows"
                self._say(words + ("" if kept.all() else f"; {(~kept).sum()} outliers left out"))
                self._draw()
                self._row_words.content = self._of_row()

    def _draw(self) -> None:
        """The errors at the tool points of their rows: arrows where they are vectors in space, else coloured points."""
        if self._data is None or self._errors is None:
            return
        data, problem, (errors, kept) = self._data, self._asked(), self._errors
        sizes = np.linalg.norm(errors, axis=1)
        values = colourings(problem, data)[self._colour.value]
        if values is None:
            values = errors[:, 0] if len(data.kind.axis_names) == 1 else sizes
        low, high = float(values[kept].min()), float(values[kept].max())
        colours = mapped_colours(values[kept], low, high).astype(np.uint8)
        solids = ArmSolids(problem.robot)
        places = np.array([solids.frames(row)[-1][:3, 3] for row in data.q[kept]])
        # The largest errors of all do not decide by how much arrows are enlarged.
        factor = enlargement(float(np.quantile(sizes[kept], 0.95)), self._extent) * 10.0**self._scale.value
        self._server.scene.remove_by_name("/measured")
        if _are_vectors(data):
            shaft, head, length = (share * self._extent for share in (0.006, 0.014, 0.03))
            self._server.scene.add_arrows(
                "/measured/errors", np.stack([places, places + factor * errors[kept]], axis=1), colours,
                shaft_radius=shaft, head_radius=head, head_length=length,
            )  # fmt: skip
        else:
            add_points(self._server, "/measured/errors", places, colours, 0.012 * self._extent)
        self._scale.label = f"Arrows {factor:.3g} times, log10"

    def _of_row(self) -> str:
        data, errors = self._data, self._errors
        if data is None or errors is None:
            return ""
        row = min(int(self._row.value), len(data)) - 1
        words = f"Row {row + 1}: {data.kind.error_words} {stated(float(np.linalg.norm(errors[0][row])), 'm')}"
        return line(words + ("." if errors[1][row] else ", an outlier."))

    def _show_row(self) -> None:
        if self._data is not None:
            self._turned(tuple(self._data.q[min(int(self._row.value), len(self._data)) - 1].tolist()))
            self._row_words.content = self._of_row()

    def _say(self, words: str) -> None:
        self._words.content = line(sentence(words.replace(*self._names)))


def _are_vectors(data: Measurements) -> bool:
    return len(data.kind.axis_names) == 3  # not one or two numbers of an instrument


def _named(effect: dict[str, Any]) -> str:
    of = next((str(effect[key]) for key in ("joint", "gear", "link", "length") if key in effect), "")
    return f"{str(effect['kind']).replace('_', ' ')} {of}".strip()
