"""Words of the command line: every option of every command with values that fit and values that do not."""

from __future__ import annotations

import random
from functools import cache

import click

from posture_opt.cli.main import main
from tests.fuzz.bases import problem_file
from tests.fuzz.case import Case, Entry, Folder, Link, Pipe
from tests.fuzz.values import WORDS, number_text, size, word
from tests.helpers.known_words import CommandLine, Option, Value, every_command_line

_FILES: dict[str, Entry] = {
    "folder": Folder(), "link": Link("nowhere"), "loop": Link("loop"), "pipe": Pipe(), "null": Link("/dev/null"),
    "zero": Link("/dev/zero"), "empty": b"", "blank.yaml": b"\n", "nul.csv": b"a\x00b",
    "p.yaml": b"robot: {kind: preset, name: planar_2r}\nuncertainty: {sigma: {joint1.theta: 1 mrad}}\n",
    "name\nof two lines.yaml": b"robot: {kind: preset, name: planar_2r}\n", "-x.csv": b"x [mm]\n1\n",
    "\x1b[31mred.yaml": b"robot: {kind: preset}\n",
}  # fmt: skip
_TABLES = ("planar_2r_measured.csv", "planar_2r_batch.csv", "bench_arm.urdf")
_PLACES = (
    *_FILES, *_TABLES, "nothing.yaml", "nothing/deep/x", "", " ", ".", "..", "/dev/null", "/dev/zero",
    "~nobody-at-all/x", "a" * 300, "a\x00b", "\udcff", "p.yaml/x", "planar_2r_measured",
)  # fmt: skip
_NAMES = ("insert_planar_2r", "insert_planar_2r_measured", "planar_2r", "insert_scara", "p.yaml")
_TEXTS = (
    "0.9 m, 0.4 m, 0 m", "0.9 m 0.4 m", "0, 0, 0", "0, -1, 0", "[0, 0, -1]", "1, 2", "0 0 0", "0.02 deg",
    "0.02 deg, 0.01 mm", "10 deg, 20 deg", "joint1=10 deg, joint2=20 deg", "joint1=10 deg", "joint1=1, joint1=2",
    "joint9=1 deg", "=", "=1", "a=", ",", ",,,", "1 m;2 m;3 m", "(1 m, 2 m, 3 m)", "0, 0, 150 mm, 0, 0, 90 deg",
    "1.2 kg", "-1 kg", "1e300 kg", "50 mm", "15x15", "3x3", "0x0", "1x1", "2x2x2", "-1x2", "1e9x1e9", "99999x99999",
    "3X3", "3×3", "x", "x=x [mm]", "x=3", "x=0", "y=99", "q=1", "1 m, nan m, 0 m", "1e308 m, 0 m, 0 m",
    "1e6 m, 0 m, 0 m", "0.2 m, 0.2 m, 0 m", "0.6 m, 0.6 m, 0 m", "insert", "probe", "weld", "custom", "trace",
)  # fmt: skip
_QUICK = {"-n": "30", "--samples": "30", "--count": "2", "--candidates": "10", "--grid": "2x2", "--starts": "4"}
_LARGEST = {"--workers": ("0", "1", "1", "1", "1", "2", "-1", "x")}
_ENDLESS = ("explore",)
"""Commands that end when they are interrupted."""
_RARE = ("--workers", "--debug", "--help", "--version")


@cache
def _commands() -> tuple[CommandLine, ...]:
    return tuple(command for command in every_command_line(click.Context(main)) if command.name not in _ENDLESS)


def cli_case(rng: random.Random, number: int) -> Case:
    """One call with random words."""
    command = rng.choice(_commands())
    words = [command.name] if command.name else []
    if rng.random() < 0.7:
        words += _usual(rng, command)
    for _ in range(rng.choice((0, 1, 1, 2, 2, 3, 5))):
        if command.options:
            option = rng.choice(command.options)
            if option.names[0] not in _RARE or rng.random() < 0.1:
                words += _option(rng, option)
    if rng.random() < 0.1:
        words.insert(
            rng.randrange(len(words) + 1), rng.choice((*WORDS, *_PLACES, "--", "-", "--no-such", "-q", "--json=1"))
        )
    if rng.random() < 0.05:
        rng.shuffle(words)
    texts = tuple(text.replace("\x00", "").encode("utf-8", "replace").decode() for text in map(str, words))
    files = {**_FILES, **{name: problem_file(name).read_bytes() for name in _TABLES if name in texts}}
    return Case("cli", number, _harmless(texts), files, _outputs(texts), _named(texts, "--checkpoint"))


def _usual(rng: random.Random, command: CommandLine) -> list[str]:
    """What the command cannot do without, and what makes it quick."""
    known = {name: option for option in command.options for name in option.names}
    words: list[str] = []
    if command.argument != Value():
        words += [_value(rng, command.argument)]
        words += [_value(rng, command.argument)] if command.name == "compare" else []
    if "--problem" in known and rng.random() < 0.8:
        words += ["--problem", rng.choice(_NAMES)]
    if "--posture" in known and rng.random() < 0.9:
        words += ["--posture", "10 deg, 20 deg"]
    if "--to" in known and rng.random() < 0.9:
        words += ["--to", rng.choice(known["--to"].value.names)]  # type: ignore[union-attr]
    for name, value in _QUICK.items():
        if (name in known and name != "-n") or (name == "-n" and "-n" in known and "--samples" not in words):
            words += [name, value] if name not in words and name != "--samples" else []
    return words


def _option(rng: random.Random, option: Option) -> list[str]:
    name = rng.choice(option.names)
    if option.value is None:
        return [name]
    if name in _LARGEST:
        return [name, rng.choice(_LARGEST[name])]
    if name in _QUICK and rng.random() < 0.7:
        return [name, rng.choice((_QUICK[name], "0", "-1", "1", "x", "1.5", "1e3", "٣", "10" * 30, ""))]
    value = _value(rng, option.value, folders=name == "--out")
    return [f"{name}={value}"] if name.startswith("--") and rng.random() < 0.1 else [name, value]


def _value(rng: random.Random, value: Value, folders: bool = False) -> str:
    choice = rng.random()
    if folders:
        return rng.choice(
            ("o", "o", "o", "o/p", "p.yaml", "folder", "link", "loop", "null", "pipe", "", " ", "a" * 300, "p.yaml/x")
        )
    if value.names and choice < 0.5:
        return rng.choice(
            value.names if choice < 0.1 else [name for name in value.names if "2r" in name] or value.names
        )
    if (value.files or value.names) and choice < 0.9:
        return rng.choice((*_PLACES, *_TABLES * 4))
    if choice < 0.75:
        return rng.choice(_TEXTS)
    return rng.choice((word(rng), number_text(rng), size(rng, rng.choice(("length", "angle", "mass")))))


def _harmless(words: tuple[str, ...]) -> tuple[str, ...]:
    """Outputs stay in the folder of the case."""
    return tuple(
        "o" if at and words[at - 1] == "--out" and (word.startswith(("/", "..", "~")) or word == ".") else word
        for at, word in enumerate(words)
    )


def _named(words: tuple[str, ...], option: str) -> tuple[str, ...]:
    """The values of an option."""
    behind = (words[at + 1] for at, word in enumerate(words[:-1]) if word == option)
    return (*behind, *(word.partition("=")[2] for word in words if word.startswith(f"{option}=")))


def _outputs(words: tuple[str, ...]) -> tuple[str, ...]:
    named = _named(words, "--out")
    starters = [f"{word.rsplit('.', 1)[0].rsplit('/', 1)[-1]}_problem.yaml" for word in words if word]
    return tuple(name.strip("/").split("/")[0] for name in (*named, *starters, *["o"] * bool(named)) if name.strip("/"))
