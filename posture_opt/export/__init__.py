"""What leaves the program for other programs and for controllers: one frozen ``Spec`` a format, listed here.

A new format is one file and one line in ``ARM_FORMATS``, or in ``PROGRAM_FORMATS`` where it is a robot program. The
names of the formats alone, as the completion of a word in a shell needs them, load no library.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posture_opt.export.export_format import ExportFormat

    EXPORTS: tuple[type[ExportFormat], ...]

# The formats of the arm and of its covariance.
ARM_FORMATS = {
    # kind -> its file, whose words in capitals are its class
    "c": "c_code",
    "python": "python_code",
    "urdf": "urdf_arm",
    "dh": "dh_table",
}
# The languages of robot programs.
PROGRAM_FORMATS = {"urscript": "ur_script", "krl": "krl", "rapid": "rapid", "jointstate": "joint_state"}


def __getattr__(name: str) -> Any:
    if name != "EXPORTS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = tuple(map(_format, (*ARM_FORMATS, *PROGRAM_FORMATS)))
    return globals()[name]


def _format(kind: str) -> type[ExportFormat]:
    home = import_module(f"posture_opt.export.{ARM_FORMATS[kind] if kind in ARM_FORMATS else PROGRAM_FORMATS[kind]}")
    words = home.__name__.rpartition(".")[2].split("_")
    found: type[ExportFormat] = getattr(home, "".join(word.capitalize() for word in words))
    return found
