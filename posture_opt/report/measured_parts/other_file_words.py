"""What reports say of a test file: whether models hold there that it had no part in, in and out of their ranges."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.blocks import Table
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count

if TYPE_CHECKING:
    from collections.abc import Mapping

    from posture_opt.calibration.second_file import OtherFile
    from posture_opt.diagnosis.causes.sessions import Gain


def effects_words(file: OtherFile, gain: Gain, model: str = MODEL_NAMES["extended"]) -> str:
    """Whether effects hold on a test file, against the arm before calibration and the calibrated one.

    One of five sentences: neither calibration nor effects hold; only the effects do not; no gain; a gain; a gain that
    is not significant with so few rows. Each has the RMS errors [mm].

    Args:
        gain: of the arm with effects, in words ``model``, over the calibrated one.
    """
    nominal, calibrated, extended = (file.models[name].rms for name in ("nominal", "calibrated", "extended"))
    sizes = _sizes(file, MODEL_NAMES | {"extended": model})
    if extended >= nominal:
        if calibrated >= nominal:
            return f"Calibration does not hold on the test file, and the effects do not correct that: {sizes}."
        return f"The effects do not hold on the test file, which is worse with them than before calibration: {sizes}."
    if extended >= calibrated:
        return f"The effects bring no gain on the test file: {sizes}."
    if gain.low > 0:
        return f"The gain holds on the test file: {sizes}."
    rows = count(len(file.data), "row")
    return f"The gain on the test file is not significant with {rows}: {sizes}."


def calibration_words(file: OtherFile) -> str:
    """Whether a calibration holds on a test file."""
    holds = "holds" if file.models["calibrated"].rms < file.models["nominal"].rms else "does not hold"
    return (
        f"Calibration {holds} on the test file: {_sizes(file, {n: MODEL_NAMES[n] for n in ('nominal', 'calibrated')})}."
    )


def _sizes(file: OtherFile, names: Mapping[str, str]) -> str:
    """RMS error 2.16 mm before calibration, 17.2 mm calibrated, 13.7 mm with effects."""
    sizes = ", ".join(f"{mm(s.rms)} mm {names[name]}" for name, s in file.models.items() if name in names)
    return f"RMS error {sizes}"


def file_words(file: OtherFile) -> str:
    """Its name, its rows, and what was fitted to it."""
    how = "base and tool fitted again to it" if file.refitted else "nothing fitted to it"
    return f"{Path(file.data.file).name or 'table'}, {count(len(file.data), 'row')}: {how}."


def range_items(file: OtherFile, models: Mapping[str, str]) -> tuple[str | Table, ...]:
    """Errors of rows inside and outside the joint ranges that were measured; nothing where all are inside.

    A sentence with the joints that leave their range, and a table of RMS errors [mm] with a row a model.
    """
    out = int(file.outside.sum())
    if not out:
        return ()
    joints = ", ".join(file.joints)
    text = f"{out} of these rows lie outside the joint ranges that the models were fitted in ({joints})."
    headers = ("RMS [mm]", f"inside ({len(file.data) - out})", f"outside ({out})")
    rows = (
        (words, *(mm(file.rms(name, rows)) for rows in (~file.outside, file.outside))) for name, words in models.items()
    )
    return (text, Table(headers, tuple(rows)))
