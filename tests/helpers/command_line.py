"""The command line in this process."""

from __future__ import annotations

from click.testing import CliRunner, Result

from posture_opt.cli.main import main


def invoke(*words: object) -> Result:
    """What ``optimize-posture`` answers to some words."""
    return CliRunner().invoke(main, [str(word) for word in words])
