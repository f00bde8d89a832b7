"""The kinds of cases, how many of each a test run has, and which case a number stands for."""

from __future__ import annotations

import random
from collections.abc import Callable

from tests.fuzz.batch_cases import batch_case
from tests.fuzz.case import Case
from tests.fuzz.cli_cases import cli_case
from tests.fuzz.csv_cases import csv_case
from tests.fuzz.data_cases import calibrate_case, diagnose_case
from tests.fuzz.instrument_cases import instrument_case
from tests.fuzz.relation_cases import relation_case
from tests.fuzz.schema_cases import schema_case
from tests.fuzz.urdf_cases import urdf_case
from tests.fuzz.yaml_cases import yaml_case

MAKERS: dict[str, Callable[[random.Random, int], Case]] = {
    "yaml": yaml_case, "csv": csv_case, "urdf": urdf_case, "cli": cli_case, "calibrate": calibrate_case,
    "diagnose": diagnose_case, "schema": schema_case, "instrument": instrument_case, "batch": batch_case,
    "relation": relation_case,
}  # fmt: skip
COUNTS = {"yaml": 2000, "csv": 1000, "urdf": 500, "cli": 300, "calibrate": 20, "diagnose": 20, "schema": 1400,
          "instrument": 250, "batch": 60, "relation": 300}  # fmt: skip


def case(kind: str, number: int, seed: int = 0) -> Case:
    """The case of a number: the same one in every run."""
    return MAKERS[kind](random.Random(f"{kind}:{seed}:{number}"), number)
