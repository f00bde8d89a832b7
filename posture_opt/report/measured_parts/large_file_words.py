"""What reports say of a file with very many rows: what it was thinned to, and how the rest of it is predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from posture_opt.report.measured_parts.error_table import mm
from posture_opt.report.text.words import MODEL_NAMES
from posture_opt.statements.notation import count, percent

if TYPE_CHECKING:
    from posture_opt.calibration.large_file import LargeFile


def large_file_facts(large: LargeFile | None) -> list[tuple[str, str]]:
    """How the rows were chosen, and what those left out say; nothing where all were used."""
    if large is None:
        return []
    return [("Thinned", f"{thinned_words(large)} {_block_words(large)} {enough_words(large)}")]


def thinned_words(large: LargeFile) -> str:
    """How many rows of the file were used, and how the others are predicted."""
    thinning = large.thinning
    rest = len(thinning.data) - len(thinning.rows)
    sizes = ", ".join(f"{mm(s.rms)} mm {MODEL_NAMES[name]}" for name, s in large.models.items())
    used = f"{len(thinning.rows)} of {len(thinning.data)} rows were fitted"
    return f"{used}; the other {rest} are predicted with an RMS error of {sizes}."


def _block_words(large: LargeFile) -> str:
    """How rows were drawn from a large file: by blocks of postures in the order in which they were measured.

    One posture at random from every block keeps drift and workspace represented.
    """
    thinning = large.thinning
    most = f", at most {thinning.most_of_posture} rows of each"
    if thinning.postures_used >= thinning.postures:
        return f"All {thinning.postures} postures were used{most}."
    block = f"{thinning.block:.3g} postures in a row"
    return f"One posture was drawn at random from every {block} ({count(thinning.postures_used, 'posture')}{most})."


def enough_words(large: LargeFile) -> str:
    """What is uncertain of the fit against what it leaves.

    Standard errors below a tenth of the residual RMS: more rows would not change the answer.
    """
    share = large.uncertainty / max(large.left, 1e-300)
    moves = f"The standard errors of the fit move the tool by {mm(large.uncertainty)} mm RMS, {percent(share)} of that"
    if share < 0.1:
        return f"{moves}: more rows would not change the answer."
    return f"{moves}: --rows takes more."
