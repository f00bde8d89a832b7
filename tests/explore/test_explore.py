"""The live page without a browser: what its handle says is what the command line says of the saved file."""

from __future__ import annotations

import gzip
import json
import re
import shlex
import shutil
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import posture_opt as po
from posture_opt.cli.main import main
from posture_opt.collision.obstacles import OBSTACLES
from posture_opt.explore.answers import Answer, Answers, Following, Request
from posture_opt.explore.explorer import Explorer
from posture_opt.explore.other_process import OtherProcess
from posture_opt.model.toolchain import compiled_before
from tests.helpers.shipped import PROBLEMS

pytest.importorskip("viser", reason="viser is not installed")
PLANAR = "insert_planar_2r_fixed_hole"


def until(met: Any, seconds: float = 60.0) -> None:
    """Waits until something is so."""
    end = time.monotonic() + seconds
    while not met():
        assert time.monotonic() < end, "it never was"
        time.sleep(0.02)


def settled(page: Any) -> Answer:
    """The answer of the full search to what is asked at the moment, once it is there."""
    found: list[Answer] = []

    def met() -> bool:
        answer = page._shown  # read once: an answer that is shown meanwhile is another one
        found[:] = [answer] if answer is not None and answer.whole and answer.request is page._request else []
        return bool(found)

    until(met)
    return found[0]


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    explorer = po.load_problem(PLANAR).explore(port=18080)
    yield explorer
    explorer.close()


def test_the_page_answers_what_the_command_line_answers(tmp_path: Path, capsys: Any) -> None:
    """To the last digit, for the saved file and the copied command, once the target rests."""
    page = po.load_problem(PLANAR).explore(port=18085)
    assert asked(page.url) == 200
    page.target = (0.8, 0.52349, 0.0)
    assert page.target == pytest.approx((0.8, 0.5235, 0.0), abs=1e-12)
    assert settled(page).solution is page.solution
    assert page.solution.problem.task.position[0] == 0.8
    page._away.folder = tmp_path
    assert "_explored.yaml" in page._away.save(page.problem)
    (file,) = tmp_path.glob("*.yaml")
    for given in (["--problem", str(file)], shlex.split(page.command())[1:]):
        with pytest.raises(SystemExit) as ended:
            main([*given, "--json"])
        assert ended.value.code == 0
        told = json.loads(capsys.readouterr().out)
        assert told["critical"]["sigma_max"] == page.solution.sigma_max
        assert told["posture"] == dict(page.posture)
    address = page.url.removeprefix("http://").split(":")
    page.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((address[0], int(address[1])), timeout=60)


def test_a_target_out_of_reach_has_a_reason_and_no_solution(page: Any) -> None:
    page.target = (5.0, 0.0, 0.0)
    assert "out of reach" in settled(page).reason
    assert page.solution is None
    assert page.posture is None
    page.target = (0.9, 0.4, 0.0)
    until(lambda: page.solution is not None)


def test_the_newest_request_wins() -> None:
    """Of many targets that come faster than they are solved, the last one is answered, and is the last answer."""
    shown: list[Answer] = []
    answers, problem = Answers(shown.append), po.load_problem(PLANAR)
    requests = [Request(problem.replace(task__position=[f"{900 - k} mm", "400 mm", "0 mm"])) for k in range(40)]
    try:
        for request in requests:
            answers.ask(request)
        until(lambda: shown and shown[-1].whole)
    finally:
        answers.end()
    assert shown[-1].request is requests[-1]
    assert len(shown) < 40
    asked = [requests.index(answer.request) for answer in shown]
    assert asked == sorted(asked)


@pytest.mark.long
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_first_answer_does_not_wait_for_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a compiler that does not end the answer is there, and it is the same once the compiler has ended."""
    slow, go = tmp_path / "cc", tmp_path / "go"
    slow.write_text(
        f'#!/bin/sh\ncase "$1" in --version) exec {shutil.which("cc")} --version;; esac\n'
        f'while [ ! -e "{go}" ]; do sleep 0.05; done\nexec {shutil.which("cc")} "$@"\n'
    )
    slow.chmod(0o755)
    monkeypatch.setenv("CC", str(slow))
    monkeypatch.setenv("POSTURE_OPT_CACHE", str(tmp_path / "cache"))
    following, problem = Following(), po.load_problem(PLANAR)
    try:
        first = following.solve(problem, None)
        assert following.compiling
        assert following.solve(problem, first.q).sigma == pytest.approx(first.sigma, rel=1e-9)
        go.touch()
        until(lambda: not following.compiling)
        with compiled_before():
            assert following.solve(problem, first.q).sigma == pytest.approx(first.sigma, rel=1e-9)
        assert following._fast is not None
    finally:
        following.end()


@pytest.mark.interrupts
def test_a_search_that_is_killed_begins_anew_and_a_defect_is_said() -> None:
    """Whatever ends the other process, the page gets its answer, or the reason for none."""
    search, found = OtherProcess(), []

    def killed_after(seconds: float) -> Any:
        thread = threading.Thread(target=lambda: found.append(search.call(time.sleep, seconds)))
        thread.start()
        for _ in range(2):
            until(lambda: search._process is not None)
            process = search._process
            process.kill()
            until(lambda process=process: search._process is not process)
        thread.join(60.0)
        return found.pop()

    try:
        assert "ended twice" in str(killed_after(600.0))
        assert search.call(abs, -3) == 3
        search._process.kill()  # while it had nothing to do
        assert search.call(abs, -4) == 4
        assert "bad operand type" in str(search.call(abs, "a"))
        assert search.call(abs, -5) == 5
    finally:
        search.end()
    assert search.call(abs, -6) is None
    assert search._process is None


def test_a_defect_of_one_request_does_not_end_the_page(capsys: Any) -> None:
    shown: list[Answer] = []
    answers, problem = Answers(shown.append), po.load_problem(PLANAR)
    try:
        answers.ask(Request(problem, ("a", "b")))  # type: ignore[arg-type]
        until(lambda: bool(shown))
        assert shown[0].reason
        answers.ask(Request(problem, (0.3, 0.4)))
        until(lambda: len(shown) > 1)
        assert shown[1].own is not None
    finally:
        answers.end()
    capsys.readouterr()


def test_names_are_text_and_no_markup() -> None:
    """In the title of the page, and wherever the panel writes HTML itself."""
    name = "<img src=x onerror='alert(1)'>"
    with po.load_problem(PLANAR).replace(name=name).explore(port=18150) as page:
        request = urllib.request.Request(page.url, headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            served = gzip.decompress(answer.read()).decode()
        assert "<title>posture_opt: &lt;img" in served
        assert "<img src=x" not in served
        until(lambda: page._shown is not None)
        until(lambda: "Standard deviation" in page._panel._numbers.content)
        assert "&lt;img src=x" in page._panel._numbers.content
        assert "<img" not in page._panel._numbers.content


def test_a_file_that_was_changed_meanwhile_is_kept(page: Any, tmp_path: Path) -> None:
    """What is saved then has the next name, which the command names too."""
    page._away.folder = tmp_path
    page.change("task", {"task__criterion": "trace"})
    page._away.save(page.problem)
    (first,) = tmp_path.iterdir()
    page.change("task", {"task__criterion": "worst"})
    page._away.save(page.problem)
    assert [*tmp_path.iterdir()] == [first]  # nobody has changed what this page wrote
    first.write_text(mine := first.read_text() + "# mine\n")
    assert "_explored_2.yaml written" in page._away.save(page.problem)
    assert first.read_text() == mine
    assert f"{first.stem}_2.yaml" in page.command()
    assert po.load_problem(tmp_path / f"{first.stem}_2.yaml").to_dict() == page.problem.to_dict()


def test_a_typed_target_that_no_file_can_state_is_refused_in_words(page: Any) -> None:
    before = page.target
    page._typed(np.array([1e12, 0.0, 0.0]))
    assert "not plausible" in page._panel._state.content
    assert page.target == before
    assert page._panel._place.value == pytest.approx([1e3 * v for v in before])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--host", "192.0.2.1"], "no page can be served at '192.0.2.1'"),
        ([], "Name a --problem or a --robot"),
        (["none.csv"], "no such file: none.csv"),
    ],
)
def test_what_is_refused(options: list[str], says: str, capsys: Any) -> None:
    given = options if "--problem" in options or not options else ["--problem", PLANAR, *options]
    with pytest.raises(SystemExit) as ended:
        main(["explore", "--no-browser", *given])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def asked(url: str, **headers: str) -> int:
    """The status that an address answers with."""
    try:
        return int(urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=60).status)
    except urllib.error.HTTPError as error:
        return error.code


def test_other_machines_need_the_token(capsys: Any) -> None:
    """In the address of the page and of its web socket; nothing else opens it."""
    with (
        po.load_problem(PLANAR).explore(port=18170) as private,
        Explorer(po.load_problem(PLANAR), "0.0.0.0", 18175) as page,
    ):
        assert private.reach == ""
        assert "Whoever has this address" in page.reach
        base, token = re.fullmatch(r"http://[^/]+(:\d+)/([\w-]{20,})/", page.url).groups()
        here = f"http://127.0.0.1{base}"
        assert [asked(f"{here}/{path}") for path in (f"{token}/", token, "", f"x{token}/", f"{token}x/")] == [
            200, 200, 403, 403, 403,
        ]  # fmt: skip
        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
                   "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}  # fmt: skip
        assert asked(f"{here}/", **upgrade) == 403
        assert asked(f"{here}/{token}/", **upgrade, Origin="http://elsewhere.example") == 403
    assert "Traceback" not in capsys.readouterr().err


def test_pages_of_other_sites_cannot_reach_the_page(page: Any) -> None:
    """Neither by a request of their own, nor by a name that was pointed at this machine."""
    assert page.reach == ""
    assert asked(page.url) == 200
    assert asked(page.url, Origin=page.url) == 200
    assert asked(page.url, Origin="http://elsewhere.example") == 403
    assert asked(page.url, Host=f"elsewhere.example:{page.url.rstrip('/').rpartition(':')[2]}") == 403


def test_without_viser_the_command_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(SystemExit) as ended:
        main(["explore", "--no-browser", "--problem", PLANAR])
    assert ended.value.code == 2
    assert "pip install 'posture_opt[explore]'" in capsys.readouterr().err


@pytest.mark.long
def test_obstacles_are_added_moved_resized_and_removed(tmp_path: Path) -> None:
    """What the page says of them is what the saved file says, whose comments stay; the arm keeps its distance."""
    with po.load_problem("insert_scara_cell").explore(port=18140) as page:
        page._away.folder = tmp_path
        panel, before = page._panel.obstacles, page.problem.to_dict()
        panel._add("box", panel_kind("box"))
        assert page.problem.cell.obstacles[-1].name == "box 1"
        panel.move(np.array([0.1, 0.45, 0.2]))
        assert page.problem.cell.obstacles[-1].xyz == pytest.approx((0.1, 0.45, 0.2))
        entry, _ = panel._fields["size"]
        panel._put(entry, (80.0, 90.0, 400.0))
        assert page.problem.cell.obstacles[-1].size == pytest.approx((0.08, 0.09, 0.4))
        panel._put(entry, (80.0, -90.0, 400.0))  # refused: nothing changes
        assert page.problem.cell.obstacles[-1].size == pytest.approx((0.08, 0.09, 0.4))
        found = settled(page).solution
        assert found.problem.scene.least(found.q)[0] >= page.problem.cell.clearance - 1e-6
        assert "_explored.yaml written" in page._away.save(page.problem)
        (file,) = tmp_path.glob("*.yaml")
        saved = po.load_problem(file)
        assert saved.to_dict()["cell"] == page.problem.to_dict()["cell"]
        lines = Path(page._stated.origin.file).read_text(encoding="utf-8").splitlines()
        assert [line for line in lines if line.startswith("#")] == [
            line for line in file.read_text(encoding="utf-8").splitlines() if line.startswith("#")
        ]
        panel._remove()
        assert page.problem.to_dict()["cell"] == before["cell"]


def panel_kind(word: str) -> Any:
    return next(kind for kind in OBSTACLES if word in str(kind.model_fields["kind"].annotation))


@pytest.mark.long
def test_features_with_their_workpiece_put_somewhere(tmp_path: Path, capsys: Any) -> None:
    """What the page says is what the command line says, of the best placement and of one of the user's own."""
    problem = po.load_problem("insert_scara_tray")
    with problem.explore(port=18160) as page:
        best = settled(page).solution
        assert best.sigma == po.select_posture(problem).sigma
        stations = page._panel.stations
        stations.place(np.array([0.25, 0.05, -0.08]), 0.3)
        assert settled(page).solution.w[0] == 0.25
        page._away.folder = tmp_path
        page._away.save(page.problem)
        with pytest.raises(SystemExit):
            main(["--problem", str(tmp_path / "insert_scara_tray_explored.yaml"), "--json"])
        told = json.loads(capsys.readouterr().out)
        assert told["sigma_max"] == page.solution.sigma_max
        assert told["posture"] == dict(page.posture)
        assert page.solution.sigma > best.sigma
        stations._which.value = 3
        page._redraw()
        assert "seat 3" in stations._words.content
        stations.place_best()
        assert settled(page).solution.sigma == best.sigma


@pytest.mark.long
def test_a_map_in_a_cell_shows_a_first_look_and_can_be_stopped() -> None:
    """The first look stays when the finer map is stopped; its numbers are those of a solve at each place, as clear."""
    problem = po.load_problem("insert_ur10_cell")
    with problem.explore(port=18185) as page:
        settled(page)  # two computations at a time are enough
        bench = page._panel.map
        bench.start()
        until(lambda: bench._heat is not None)
        bench._stop()
        until(lambda: not bench._bar.visible)
        heat = bench._heat
        assert heat.sigma.shape == (5, 5)
        assert "5 by 5 places" in bench._words.content
        selector = po.PostureSelector(problem, offers=False, explains=False)
        for row, column in ((0, 0), (2, 2), (0, 4), (4, 1)):
            place = heat.origin + heat.values[0][column] * heat.axes[0] + heat.values[1][row] * heat.axes[1]
            try:
                sigma = selector.solve(place).sigma_max
            except po.errors.NoSolutionError:
                sigma = np.nan
            np.testing.assert_allclose(heat.sigma[row, column], sigma, rtol=1e-5)
        page.target = heat.best
        assert settled(page).solution.sigma_max == pytest.approx(np.nanmin(heat.sigma), rel=1e-3)  # to 0.1 mm


@pytest.mark.long
def test_measurements_have_the_errors_that_the_model_leaves(tmp_path: Path) -> None:
    """Positions of the model with a hidden compliance: no error with the cause, and one that points to them without."""
    problem = po.load_problem(PLANAR).replace(
        robot__base={"xyz": ["0 m", "0 m", "0 m"], "rpy": ["0 deg", "0 deg", "0 deg"]},
        effects=[{"kind": "joint_scale", "joint": "joint2", "estimate": {"scale": 0.01}}],
    )
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (30, 2))
    a, b = q[:, 0], q[:, 0] + 1.01 * q[:, 1]
    at = 1e3 * np.column_stack([np.cos(a) + np.cos(b), np.sin(a) + np.sin(b)])
    rows = ["joint1 [deg],joint2 [deg],x [mm],y [mm]"]
    rows += [",".join(f"{v:.9f}" for v in (*np.degrees(qs), *xy)) for qs, xy in zip(q, at, strict=True)]
    with problem.explore(port=18180) as page:
        measured = page._panel.measured
        measured.read("a.csv", b"joint1 [deg]\n1\n")
        assert "a.csv" in measured._words.content
        measured.read("b.csv", "\n".join(rows).encode())
        until(lambda: measured._errors is not None)
        assert np.max(np.abs(measured._errors[0])) < 1e-8
        measured._causes[0].value = False
        measured.compute()
        until(lambda: np.max(np.abs(measured._errors[0])) > 1e-4)
        without = np.column_stack([np.cos(a) + np.cos(q.sum(axis=1)), np.sin(a) + np.sin(q.sum(axis=1))])
        np.testing.assert_allclose(measured._errors[0][:, :2], at / 1e3 - without, atol=1e-8)
        measured._row.value = 7
        measured._show_row()
        until(lambda: page._shown is not None and page._shown.own is not None)
        assert page._shown.own.q == pytest.approx(q[6], abs=1e-8)


def test_the_folder_of_a_result_is_the_arm_that_it_delivered(tmp_path: Path) -> None:
    """That of a diagnosis before that of a calibration; a folder without either is no problem file."""
    with pytest.raises(po.errors.InputError, match="this is a folder"):
        po.load_problem(tmp_path)
    for name, kind in (("calibrated", "insert_panda"), ("extended", PLANAR)):
        (tmp_path / f"{name}.yaml").write_bytes((PROBLEMS / f"{kind}.yaml").read_bytes())
        assert po.load_problem(tmp_path).to_dict() == po.load_problem(kind).to_dict()


@pytest.mark.interrupts
def test_the_command_prints_its_address_and_ends_by_a_signal() -> None:
    command = [sys.executable, "-m", "posture_opt", "explore", "--problem", PLANAR, "--no-browser", "--port", "18090"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Listening on http://127.0.0.1:18")
        assert asked(line.split()[-1]) == 200
        process.terminate()
        out, _ = process.communicate(timeout=60)
        assert out == ""
        assert process.returncode == 128 + 15
