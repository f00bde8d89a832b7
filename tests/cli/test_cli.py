"""The command line: exit codes, messages, JSON, and files that appear whole or not at all."""

from __future__ import annotations

import ast
import json
import os
from pathlib import Path

import pytest

import posture_opt as po
from posture_opt.cli.main import COMMANDS
from posture_opt.problem.starter import starter_text
from posture_opt.robot import preset_names
from tests.helpers.command_line import invoke
from tests.helpers.folders import names
from tests.helpers.fresh import ROOT, loaded_by

PLANAR = ["--problem", "insert_planar_2r"]
DOWN = ["--posture", "90 deg, -180 deg"]


def test_help_names_every_command_and_imports_none() -> None:
    result = invoke("--help")
    assert result.exit_code == 0
    assert all(name in result.output for name in COMMANDS)
    assert invoke().output.startswith("Usage: optimize-posture")
    assert loaded_by("from posture_opt.cli.main import main", "casadi", "yaml") == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulat"], "Did you mean 'simulate'?"),
        (["--problm", "x"], "--problem"),
        (["--problem", "a.yaml", "--robot", "ur10e", "--task", "insert"], "--problem and --robot both name a robot"),
        (["--robot", "ur10e"], "Name the --task"),
        ([*PLANAR, "--sigma", "1 deg"], "go with --robot"),
        (["--problem", "x.yaml", "simulate"], "Write --problem after 'simulate'"),
        (["simulate", *DOWN], "Name a --problem or a --robot"),
        (["simulate", *PLANAR, *DOWN, "-n", "1"], "-n"),
        (["--task", "insert", "--workers", "0"], "--workers"),
        (["export", *PLANAR, "--to", "fortran"], "--to"),
        (["new"], "Name a preset: "),
    ],
)
def test_wrong_usage_is_exit_code_2(words: list[str], message: str) -> None:
    result = invoke(*words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--task", "insrt"], "--task: 'insrt' is not known here – did you mean 'insert'?"),
        (["--problem", "no/such.yaml"], "no such file: no/such.yaml"),
        (["--task", "insert", "--robot", "ur10f"], "--robot: there is no preset 'ur10f' – did you mean 'ur10'"),
        (
            ["--task", "insert", "--robot", "ur10e", "--position", "1, 0 m, 0 m"],
            "--position[0]: the length has no unit",
        ),
        (["--task", "insert", "--robot", "ur10e", "--direction", "0, 0, 0"], "--direction: a direction of length zero"),
        (["--task", "insert", "--robot", "ur10e", "--sigma", "-1 deg"], "error: --sigma: the standard"),
        (["--task", "insert", "--robot", "ur10e", "--sigma", "0.02 mm"], "all are revolute, write an angle: 0.02 deg"),
        (["--task", "insert", "--robot", "scara", "--sigma", "1 deg, 2 deg"], "two angles, 1 deg and 2 deg"),
        (
            ["--task", "insert", "--robot", "ur10e", "--link-height", "5"],
            "error: --link-height: the length has no unit",
        ),
        (["--robot", "ur10e", "--link-height", "5 mm"], "Name the --task of the robot"),
        (["--problem", "insert_scrara"], "no such file: insert_scrara – did you mean the built-in 'insert_scara'?"),
        (["new", "ur10f"], "PRESET: there is no preset 'ur10f' – did you mean 'ur10'?"),
        (["uncertainty", *PLANAR, "--posture", "90 deg"], "--posture: 1 value for 2 joints – give one value each"),
        (["uncertainty", *PLANAR, "--posture", "90, 90 deg"], "--posture.joint1: the angle has no unit"),
        (["uncertainty", *PLANAR, "--posture", "joint1=1 deg"], "--posture: no value for joint2"),
        (["uncertainty", *PLANAR, "--posture", "jont1=1 deg, joint2=1 deg"], "did you mean 'joint1'"),
        (["export", *PLANAR, "--to", "c", "--name", "1x"], "'1x' is no C identifier"),
    ],
)
def test_bad_input_is_exit_code_2_with_the_hint(words: list[str], message: str) -> None:
    result = invoke(*words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert result.stdout == ""
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("task", "uncertainty", "words", "message"),
    [
        ("", "sigma: {joint1.theta: 1 deg}", [], "p.yaml:1: task: the problem states no task – add task: {kind"),
        ("task: {kind: insert}", "sigma: {}", [], "p.yaml:2: uncertainty: nothing is uncertain"),
        ("task: {kind: insert, direction: [1, 0, 0]}", "sigma: {joint1.theta: 1 deg}", ["--task", "drill"], "--task: "),
        ("task:\n  direction: [1, 0, 0]\n  kind: drill", "sigma: {joint1.theta: 1 deg}", [], "p.yaml:5: task.kind: "),
    ],
)
def test_a_fault_that_shows_in_solving_has_its_place(
    task: str, uncertainty: str, words: list[str], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(f"robot: {{kind: preset, name: planar_2r}}\nuncertainty: {{{uncertainty}}}\n{task}\n")
    result = invoke("--problem", str(path), *words)
    assert result.exit_code == 2
    assert result.stderr.replace(f"{tmp_path}/", "").startswith(f"error: {message}")


def test_unexpected_failure_is_one_line_unless_debugged(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: object, **named: object) -> None:
        raise ZeroDivisionError("first\nsecond")

    monkeypatch.setattr("posture_opt.cli.request.requested_problem", broken)
    result = invoke("--task", "insert")
    assert result.exit_code == 1
    assert result.stderr == "error: ZeroDivisionError: first (a defect of this program; --debug shows where)\n"
    assert "Traceback" in invoke("--task", "insert", "--debug").stderr


def test_schema_is_json_and_goes_to_a_file(tmp_path: Path) -> None:
    schema = json.loads(invoke("schema").stdout)
    assert schema["title"] == "Problem file of posture_opt"
    assert invoke("schema", "--out", str(tmp_path / "s.json")).exit_code == 0
    assert json.loads((tmp_path / "s.json").read_text()) == schema
    assert os.listdir(tmp_path) == ["s.json"]


def test_list_names_what_files_may_name() -> None:
    tables = json.loads(invoke("list", "--json").stdout)
    assert {row["name"] for row in tables["presets"]} == set(preset_names())
    assert {row["kind"] for row in tables["tasks"]} >= {
        "insert",
        "drill",
        "probe",
        "measure",
        "trace",
        "place",
        "weld",
        "hold",
    }
    assert "insert_planar_2r" in invoke("list").stdout


def test_new_replaces_a_file_only_on_demand(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("precious")
    assert invoke("new", "ur10e", "--out", str(path)).exit_code == 2
    assert path.read_text() == "precious"
    assert invoke("new", "ur10e", "--out", str(path), "--force").exit_code == 0
    assert path.read_text() == starter_text("ur10e").rstrip("\n") + "\n"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_out_of_a_failed_run_is_left_as_it_was(
    error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*args: object, **named: object) -> None:
        raise error

    monkeypatch.setattr(po, "select_posture", broken)
    kept = tmp_path / "kept"
    kept.mkdir()
    for out in (kept, tmp_path / "new" / "deep"):
        assert invoke("--task", "insert", "--out", str(out)).exit_code != 0
    assert os.listdir(tmp_path) == ["kept"]
    assert os.listdir(kept) == []


@pytest.mark.parametrize("out", ["file", "file/below", "/proc/none"])
def test_out_that_cannot_be_written_is_told_before_computing(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("1")
    monkeypatch.setattr(po, "select_posture", lambda *args, **named: pytest.fail("it computed"))
    result = invoke("--task", "insert", "--out", out)
    assert result.exit_code == 2
    assert f"--out: cannot write to {out}: " in result.stderr
    assert os.listdir(tmp_path) == ["file"]


def test_out_of_reach_is_exit_code_3(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ["--task", "insert", *PLANAR, "--position", "3 m, 0 m, 0 m", "--out", str(out), "--no-plots"]
    result = invoke(*words)
    assert result.exit_code == 3
    assert "out of reach by 1000 mm" in result.stderr, "links of 1 m and 1 m, the target at 3 m"
    assert "out of reach by 1000 mm" in result.stdout
    assert json.loads((out / "solution.json").read_text())["status"] == "infeasible"
    assert json.loads(invoke(*words, "--json").stdout)["status"] == "infeasible"


def test_files_of_an_earlier_report_do_not_stay_beside_the_new_one(tmp_path: Path) -> None:
    own = ["cloud.csv", "report.html", "report.txt", "spread.json"]
    (tmp_path / "arm.png").write_text("somebody's")
    (tmp_path / "joint_map.txt").write_text("somebody's")
    simulate = ["simulate", *PLANAR, *DOWN, "-n", "10", "--no-plots", "--quiet", "--out", str(tmp_path)]
    assert invoke(*simulate).exit_code == 0
    assert names(tmp_path) == sorted(["arm.png", "joint_map.txt", *own])
    assert invoke("--task", "insert", "--no-plots", "--quiet", "--out", str(tmp_path)).exit_code == 0
    assert names(tmp_path) == ["arm.png", "joint_map.txt", "report.html", "report.txt", "solution.json"]
    assert invoke("schema", "--out", str(tmp_path / "schema.json")).exit_code == 0
    assert len(names(tmp_path)) == 6, "what is no report replaces none"


def test_a_file_of_somebody_else_is_named_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "report.html").write_text("somebody's")
    monkeypatch.setattr(po, "select_posture", lambda *args, **named: pytest.fail("it computed"))
    found = invoke("--task", "insert", "--out", str(tmp_path))
    assert found.exit_code == 2
    assert "report.html there was not written by this program" in found.stderr
    assert (tmp_path / "report.html").read_text() == "somebody's"


def test_public_names_are_listed_alike_everywhere() -> None:
    assert set(po.__all__) <= set(dir(po))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        po.nothing  # noqa: B018
    typed = next(
        node for node in ast.parse((ROOT / "posture_opt/__init__.py").read_text()).body if isinstance(node, ast.If)
    )
    names = {alias.name for node in typed.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert names == set(po.__all__) - {"__version__"}, "what type checkers see is what there is"


def test_of_many_issues_the_first_and_their_number_are_told(tmp_path: Path) -> None:
    keys = "".join(f"key{k}: 1\n" for k in range(500))
    (tmp_path / "p.yaml").write_text(f"robot: {{kind: preset, name: planar_2r}}\n{keys}")
    result = invoke("--problem", str(tmp_path / "p.yaml"))
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert lines[0] == "500 errors:"
    assert len(lines) == 22
    assert lines[-1].strip() == "and 480 more"


def test_words_that_are_no_text_are_refused() -> None:
    for words in (("--task", "\udcff"), ("--task", "insert", "--robot", "ur5e", "--position", "\udcff m, 0 m, 0 m")):
        result = invoke(*words)
        assert result.exit_code == 2
        assert r"the argument is not UTF-8" in result.stderr


@pytest.mark.parametrize("command", [["uncertainty", *DOWN], ["simulate", *DOWN], ["--task", "insert"]])
def test_nothing_uncertain_names_the_option(command: list[str]) -> None:
    result = invoke(*command, "--robot", "planar_2r")
    assert result.exit_code == 2
    assert result.stderr.startswith("error: --sigma: nothing is uncertain")
    assert '– write for example --sigma "0.02 deg"' in result.stderr


def test_targets_out_of_reach_print_the_document_of_the_error(tmp_path: Path) -> None:
    off = tmp_path / "off.csv"
    off.write_text("x [mm], y [mm], z [mm]\n1000, 500, 100\n")
    refused = invoke("compensate", str(off), "--problem", "insert_planar_2r", "--json")
    assert refused.exit_code == 3
    assert json.loads(refused.stdout)["error"]["code"] == 3
