"""Shell completion: the scripts as the shells themselves run them, in a folder with files of every kind."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from posture_opt.cli.main import COMMANDS, main
from posture_opt.problem.load import builtin_names
from posture_opt.robot import preset_names
from posture_opt.selection.tasks import TASKS

FILES = ("my cell.yaml", "mine.yml", "data.csv", "arm.urdf", "notes.txt", "results/")
TASK_KINDS = {task.model_fields["kind"].annotation.__args__[0] for task in TASKS}  # type: ignore[union-attr]
TRIES = [
    # words before the cursor, what is completed there
    (["ca"], {"calibrate"}),
    (["plan"], {"plan-measurements"}),
    (["--ta"], {"--task"}),
    (["--task", ""], TASK_KINDS),
    (["map", "--task", "dr"], {"drill"}),
    (["--robot", "ur5"], {"ur5", "ur5e"}),
    (["--robot", "arm"], {"arm.urdf"}),
    (["--problem", "insert_panda"], {name for name in builtin_names() if name.startswith("insert_panda")}),
    (["--problem", "mi"], {"mine.yml"}),
    (["--problem", "my"], {"my cell.yaml"}),
    (["map", "--plane", ""], {"xy", "xz", "yz"}),
    (["map", "--out", "re"], {"results"}),
    (["map", "--position", ""], set()),
    (["diagnose", "da"], {"data.csv"}),
    (["diagnose", "data.csv", "--problem", "insert_ur10_m"], {"insert_ur10_measured"}),
    (["compare", "mi"], {"mine.yml"}),
    (["new", "ur10"], {"ur10", "ur10e"}),
    (["--problem", "map", "--ro"], {"--robot"}),  # a value that is called like a command
    (["completion", ""], {"bash", "fish", "zsh"}),
]


@cache
def script(shell: str) -> str:
    result = CliRunner().invoke(main, ["completion", shell])
    assert result.exit_code == 0
    return result.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / name).mkdir() if name.endswith("/") else (tmp_path / name).touch()
    return tmp_path


def ran(shell: str, text: str, folder: Path, *words: str) -> str:
    """What a shell prints that has read the script and nothing else: no program of ours is in reach."""
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"there is no {shell} here")
    (folder / ".script").write_text(script(shell), encoding="utf-8")
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(folder), "LANG": "C.UTF-8"}
    done = subprocess.run(
        [program, "-c", text, shell, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=30
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize(("words", "expected"), TRIES, ids=[" ".join(words) for words, _ in TRIES])
def test_bash_completes(words: list[str], expected: set[str], folder: Path) -> None:
    text = """source .script; COMP_WORDS=(optimize-posture "$@"); COMP_CWORD=$#
              _optimize_posture; printf '%s\\n' "${COMPREPLY[@]}" """
    assert {line for line in ran("bash", text, folder, *words).splitlines() if line} == expected


def test_bash_takes_the_equals_sign_as_a_word_of_its_own(folder: Path) -> None:
    text = """source .script; COMP_WORDS=(optimize-posture "$@"); COMP_CWORD=$#
              _optimize_posture; printf '%s\\n' "${COMPREPLY[@]}" """
    assert ran("bash", text, folder, "--problem", "=", "mi").split() == ["mine.yml"]
    assert "drill" in ran("bash", text, folder, "--task", "=").split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("ca", {"calibrate"}),
        ("--task in", {"insert"}),
        ("--robot ur5", {"ur5", "ur5e"}),
        ("map --plane x", {"xy", "xz"}),
        ("diagnose da", {"data.csv"}),
        ("new ur10", {"ur10", "ur10e"}),
    ],
)
def test_fish_completes(line: str, expected: set[str], folder: Path) -> None:
    shown = ran("fish", f"source .script; complete -C 'optimize-posture {line}'", folder)
    assert {entry.split("\t")[0] for entry in shown.splitlines()} == expected


def test_zsh_reads_its_script(folder: Path) -> None:
    text = "autoload -U compinit; compinit -u -D; source .script; print ${_comps[optimize-posture]}"
    assert ran("zsh", text, folder).strip() == "_optimize-posture"


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_every_command_option_and_name_is_there(shell: str) -> None:
    text = script(shell)
    group = main
    assert isinstance(group, click.Group)
    options = {
        option.removeprefix("--")
        for name in COMMANDS
        for parameter in (group.get_command(click.Context(group), name) or group).params
        if isinstance(parameter, click.Option) and not parameter.hidden
        for option in parameter.opts
        if option.startswith("--")
    }
    missing = {
        word for word in {*COMMANDS, *options, *preset_names(), *builtin_names(), *TASK_KINDS} if word not in text
    }
    assert missing == set()
