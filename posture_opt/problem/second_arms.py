"""Second arms from their own problem files: what touches measure is in the file of the first."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from posture_opt.errors import InputError, Issue
from posture_opt.files import located
from posture_opt.measurements.data_section import DataSpec
from posture_opt.problem.yaml_source import ProblemDocument, read_yaml

OF_ARM = ("name", "robot", "uncertainty", "effects")
"""Sections of a problem file that say what the arm is: its data may name the first arm as the second of its own."""
ReadParts = Callable[[ProblemDocument, Path, Mapping[str, str]], tuple[Any, Any, Any]]


def with_second_arms(data: DataSpec, folder: Path, read_parts: ReadParts) -> DataSpec:
    """The section ``data`` with what the problem files of second arms say.

    Args:
        folder: where relative names start; read_parts: reads a document.

    Raises:
        InputError: no such file, or one that cannot be used.
    """
    if not data.pairs:
        return data
    pairs, issues = dict(data.pairs), list[Issue]()
    for name, pair in data.pairs.items():
        try:
            path = located(folder, pair.problem)
            _, (_, arm), (sources, _) = read_parts(second_document(path), path.parent, {})
            sigmas = dict(zip(sources.names, map(float, np.sqrt(np.diag(sources.constant))), strict=True))
            pairs[name] = pair.with_arm(arm, sigmas)
        except InputError as error:
            issues += [i if i.file else i.at("data", "pairs", name, "problem") for i in error.issues]
    if issues:
        raise InputError(issues)
    return data.model_copy(update={"pairs": pairs})


def second_document(path: Path) -> ProblemDocument:
    """What a problem file says of its arm.

    Raises:
        InputError: no such file, or no problem file.
    """
    document = read_yaml(path)
    return replace(document, data={key: value for key, value in document.data.items() if key in OF_ARM})
