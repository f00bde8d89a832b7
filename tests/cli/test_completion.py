"""Shell completion: click's scripts as the shells themselves run them, in a folder with files of every kind."""

from __future__ import annotations

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner

import posture_opt
from posture_opt.cli.completion import TASK, completed_files
from posture_opt.cli.main import COMMANDS, main
from posture_opt.export import ARM_FORMATS, PROGRAM_FORMATS
from posture_opt.export.export_files import export_kinds
from posture_opt.selection.tasks import TASKS
from tests.helpers.shipped import builtin_names

FILES = ("my cell.yaml", "mine.yml", "data.csv", "arm.urdf", "notes.txt", "results/")
TASK_KINDS = {task.model_fields["kind"].annotation.__args__[0] for task in TASKS}  # type: ignore[union-attr]
TRIES = [
    # words before the cursor, what is completed there
    (["ca"], {"calibrate"}),
    (["--ta"], {"--task"}),
    (["--task", ""], TASK_KINDS),
    (["--robot", "arm"], {"arm.urdf"}),
    (["--problem", "insert_panda"], {name for name in builtin_names() if name.startswith("insert_panda")}),
    (["--problem", "my"], {r"my\ cell.yaml"}),
    (["map", "--out", "re"], {"results/"}),
    (["map", "--position", ""], set()),
    (["diagnose", "da"], {"data.csv"}),
    (["new", "ur10"], {"ur10", "ur10e"}),
    (["--problem", "map", "--ro"], {"--robot"}),  # a value that is called like a command
    (["compensate", "data.csv", "--program", "k"], {"krl"}),
    (["no-such-command", "cal"], {"calibrate"}),
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
    program = tmp_path / ".bin" / "optimize-posture"
    program.parent.mkdir()
    root = Path(posture_opt.__file__).parents[1]
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH="{root}" exec "{sys.executable}" -m posture_opt "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)
    return tmp_path


def ran(shell: str, text: str, folder: Path, *words: str, **asked: str) -> str:
    """What a shell prints that has read the script."""
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"there is no {shell} here")
    (folder / ".script").write_text(script(shell) if shell in ("bash", "zsh", "fish") else "", encoding="utf-8")
    environment = {"PATH": f"{folder}/.bin:/usr/bin:/bin", "HOME": str(folder), "LANG": "C.UTF-8", **asked}
    done = subprocess.run(
        [program, "-c", text, shell, *words], cwd=folder, env=environment, capture_output=True, text=True, timeout=30
    )
    assert done.stderr == ""
    return done.stdout


def in_bash(folder: Path, *words: str) -> set[str]:
    """What bash may put at the cursor behind these words."""
    text = """source .script; COMP_WORDS=(optimize-posture "$@"); COMP_CWORD=$#
              _optimize_posture_completion optimize-posture; printf '%s\\n' "${COMPREPLY[@]}" """
    return {line for line in ran("bash", text, folder, *words).splitlines() if line}


@pytest.mark.parametrize(("words", "expected"), TRIES, ids=[" ".join(words) for words, _ in TRIES])
def test_bash_completes(words: list[str], expected: set[str], folder: Path) -> None:
    assert in_bash(folder, *words) == expected


def test_bash_takes_the_equals_sign_as_a_word_of_its_own(folder: Path) -> None:
    assert in_bash(folder, "--problem", "=", "mi") == {"mine.yml"}
    assert in_bash(folder, "--task", "=") == TASK_KINDS


def test_zsh_reads_its_script(folder: Path) -> None:
    text = "autoload -U compinit; compinit -u -D; source .script; print ${_comps[optimize-posture]}"
    assert ran("zsh", text, folder).strip() == "_optimize_posture_completion"


def test_the_program_answers_the_scripts_of_zsh_and_fish(folder: Path) -> None:
    """Also where these shells are not installed: type, word and help text, as click's scripts read them."""
    words = {"COMP_WORDS": "optimize-posture ca", "COMP_CWORD": "1"}
    zsh = ran("sh", "optimize-posture", folder, _OPTIMIZE_POSTURE_COMPLETE="zsh_complete", **words)
    assert zsh.splitlines() == ["plain", "calibrate", COMMANDS["calibrate"]]
    words = {"COMP_WORDS": "optimize-posture --problem my", "COMP_CWORD": "my"}
    fish = ran("sh", "optimize-posture", folder, _OPTIMIZE_POSTURE_COMPLETE="fish_complete", **words)
    assert fish.splitlines() == ["plain,my cell.yaml"]


def test_a_folder_that_is_the_only_one_is_looked_into(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "cells" / "old").mkdir(parents=True)
    for name in ("a.yaml", "b.yaml", "b.txt"):
        (folder / "cells" / name).touch()

    def shown(begun: str, *endings: str, folders: bool = False) -> list[str]:
        return [item.value for item in completed_files(begun, endings, folders=folders)]

    assert shown("ce", ".yaml") == ["cells/a.yaml", "cells/b.yaml", "cells/old/"]
    assert shown("cells/b") == ["cells/b.txt", "cells/b.yaml"]
    assert shown("ce", folders=True) == ["cells/", "cells/old/"]
    assert shown(f"{folder}/ce", ".yaml")[0] == f"{folder}/cells/a.yaml"
    assert shown("nowhere/a") == []
    assert not any(name.startswith(".") for name in shown(""))


@pytest.mark.parametrize("command", ["", "diagnose"])
def test_completing_a_word_loads_no_library(command: str, folder: Path) -> None:
    """A library costs more than a tenth of a second, with every press of the tab key."""
    code = """if True:
        import sys
        from posture_opt.cli.completion import complete
        from posture_opt.cli.main import main
        complete(main, "bash_complete")
        print(*({"numpy", "casadi", "pydantic", "yaml", "scipy", "matplotlib"} & set(sys.modules)), file=sys.stderr)
    """
    words = f"optimize-posture {command} --"
    environment = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1), "PATH": "/usr/bin:/bin"}
    root = Path(posture_opt.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stderr.strip() == ""
    assert "plain,--help" in done.stdout.splitlines()


def test_the_names_of_the_exports_are_those_of_their_classes() -> None:
    assert tuple(ARM_FORMATS | PROGRAM_FORMATS) == tuple(export_kinds())


def test_the_names_of_the_tasks_are_those_of_their_classes() -> None:
    assert set(TASK.names()) == TASK_KINDS
