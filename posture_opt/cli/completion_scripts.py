"""Completion scripts of shells: what stands before the cursor says what may come, from lists that the script holds."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence

from posture_opt.cli.command_line import CommandLine, Option, Value

_HEAD = "# Completion of optimize-posture for {}; made by 'optimize-posture completion {}', again after an update."

_BASH = """\
_optimize_posture_files() {
    local ending
    compopt -o filenames 2>/dev/null
    while IFS= read -r name; do COMPREPLY+=("$name"); done < <(
        compgen -d -- "$cur"
        if (($# == 0)); then compgen -f -- "$cur"; fi
        for ending in "$@"; do compgen -f -X "!*$ending" -- "$cur"; done
    )
}

_optimize_posture() {
    local cur=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command="" i name
    COMPREPLY=()
    if [[ $cur == "=" ]]; then cur=""; fi
    if [[ $before == "=" ]]; then before=${COMP_WORDS[COMP_CWORD - 2]}; fi
    for ((i = 1; i < COMP_CWORD; i++)); do
        case ${COMP_WORDS[i]} in
            @COMMANDS@) command=${COMP_WORDS[i]}; break ;;
            @TAKING@) ((i++)) ;;
        esac
    done
    case "$command $before" in
@VALUES@
    esac
    case "$command" in
@WORDS@
    esac
}
complete -F _optimize_posture optimize-posture
"""

_ZSH = """\
#compdef optimize-posture
@HEAD@
_optimize-posture() {
    local before=${words[CURRENT-1]} command="" i
    for ((i = 2; i < CURRENT; i++)); do
        case ${words[i]} in
            (@COMMANDS@) command=${words[i]}; break ;;
            (@TAKING@) ((i++)) ;;
        esac
    done
    case "$command $before" in
@VALUES@
    esac
    local -a options others
    case "$command" in
@WORDS@
    esac
}
if [[ $funcstack[1] == _optimize-posture ]]; then
    _optimize-posture "$@"
else
    compdef _optimize-posture optimize-posture
fi
"""


def bash(lines: Sequence[CommandLine]) -> str:
    """The script for bash."""
    values, words = [], []
    for line in lines:
        for option in _taking(line):
            assert option.value is not None
            place = "|".join(f'"{line.name} {name}"' for name in option.names)
            values.append(f"        {place}) {_bash_value(option.value)}return ;;")
        names = " ".join(name for option in line.options for name in option.names)
        first = f'COMPREPLY=($(compgen -W {shlex.quote(names)} -- "$cur")); return'
        rest = _bash_value(line.argument) if line.name else _bash_names([other.name for other in lines if other.name])
        words.append(f'        "{line.name}") if [[ $cur == -* ]]; then {first}; fi; {rest};;')
    return f"{_HEAD.format('bash', 'bash')}\n{_filled(_BASH, lines, values, words)}"


def _bash_value(value: Value) -> str:
    names = _bash_names(value.names) if value.names else ""
    if value.folders:
        return f'{names}_optimize_posture_files "/"; '
    return f"{names}_optimize_posture_files {' '.join(value.endings)}; " if value.files else names


def _bash_names(names: Sequence[str]) -> str:
    return f'COMPREPLY=($(compgen -W {shlex.quote(" ".join(names))} -- "$cur")); '


def zsh(lines: Sequence[CommandLine]) -> str:
    """The script for zsh."""
    values, words = [], []
    for line in lines:
        for option in _taking(line):
            assert option.value is not None
            place = "|".join(f'"{line.name} {name}"' for name in option.names)
            values.append(f"        ({place}) {_zsh_value(option.value)}return ;;")
        options = " ".join(_zsh_entry(name, option.help) for option in line.options for name in option.names)
        commands = " ".join(_zsh_entry(other.name, other.help) for other in lines if other.name)
        rest = _zsh_value(line.argument) if line.name else f"others=({commands}); _describe command others; "
        shown = "[[ $PREFIX == -* ]] && _describe option options"
        words.append(f'        ("{line.name}") options=({options}); {rest}{shown} ;;')
    return _filled(_ZSH, lines, values, words).replace("@HEAD@", _HEAD.format("zsh", "zsh"))


def _zsh_value(value: Value) -> str:
    names = f"compadd -- {' '.join(map(shlex.quote, value.names))}; " if value.names else ""
    if value.folders:
        return f"{names}_files -/; "
    # A group at the end of a pattern is a list of qualifiers to zsh, unless it holds a bar.
    ending = f"({'|'.join(value.endings)})" if len(value.endings) > 1 else "".join(value.endings)
    pattern = f" -g '*{ending}'" if ending else ""
    return f"{names}_files{pattern}; " if value.files else names


def _zsh_entry(name: str, told: str) -> str:
    return shlex.quote(f"{name}:{told}" if told else name)


def fish(lines: Sequence[CommandLine]) -> str:
    """The script for fish."""
    commands = [line for line in lines if line.name]
    outside = f"not __fish_seen_subcommand_from {' '.join(line.name for line in commands)}"
    told = [_HEAD.format("fish", "fish"), "complete -c optimize-posture -f"]
    for line in lines:
        place = f"__fish_seen_subcommand_from {line.name}" if line.name else outside
        start = f"complete -c optimize-posture -n {shlex.quote(place)}"
        for option in line.options:
            names = " ".join(f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in option.names)
            value = "" if option.value is None else f" -r{_fish_value(option.value)}"
            told.append(f"{start} {names}{value} -d {_fish_quoted(option.help)}")
        if line.argument.names or line.argument.files:
            told.append(f"{start}{_fish_value(line.argument)}")
    start = f"complete -c optimize-posture -n {shlex.quote(outside)}"
    told += [f"{start} -a {line.name} -d {_fish_quoted(line.help)}" for line in commands]
    return "\n".join(told) + "\n"


def _fish_quoted(text: str) -> str:
    """A text in single quotes, in which fish knows two escapes."""
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


def _fish_value(value: Value) -> str:
    if value.folders:
        return " -a '(__fish_complete_directories)'"
    parts = list(value.names)
    parts += [f"(__fish_complete_suffix {ending})" for ending in value.endings]
    kept = " -F" if value.files and not value.endings else " -f"
    return f"{kept} -a {shlex.quote(' '.join(parts))}" if parts else kept


def _taking(line: CommandLine) -> list[Option]:
    """The options that take a value."""
    return [option for option in line.options if option.value is not None]


def _filled(script: str, lines: Sequence[CommandLine], values: Sequence[str], words: Sequence[str]) -> str:
    taking = dict.fromkeys(name for option in _taking(lines[0]) for name in option.names)
    parts = {
        "@COMMANDS@": "|".join(line.name for line in lines if line.name),
        "@TAKING@": "|".join(taking),
        "@VALUES@": "\n".join(values),
        "@WORDS@": "\n".join(words),
    }
    for mark, part in parts.items():
        script = script.replace(mark, part)
    return script


SCRIPTS: dict[str, Callable[[Sequence[CommandLine]], str]] = {"bash": bash, "fish": fish, "zsh": zsh}
