"""What a result has to say, as data: statements, quantities, and the catalogue of their sentences."""

from posture_opt.statements.quantity import Quantity, p_value, p_words
from posture_opt.statements.statement import (
    SEVERITIES,
    Entry,
    Severity,
    Statement,
    Value,
    by_severity,
    every_entry,
    state,
)

__all__ = [
    "SEVERITIES",
    "Entry",
    "Quantity",
    "Severity",
    "Statement",
    "Value",
    "by_severity",
    "every_entry",
    "p_value",
    "p_words",
    "state",
]
