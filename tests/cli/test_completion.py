"""Completion of both tools in the user's shell: verbs, options and the values that an option takes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from prf.shell.run import run_app

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
VERBS = [(tool, verb) for tool, module in TOOLS.items() for verb in module.VERBS]
HEAVY = {"numpy", "numba", "scipy", "matplotlib", "shapely", "arviz_stats", "maxflow"}
ASK = """
eval "$({variable}=source_bash {tool})"
COMP_WORDS=({words})
COMP_CWORD={place}
_{tool}_completion {tool}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment that finds both tools by their names."""
    folder = tmp_path_factory.mktemp("bin")
    for tool in TOOLS:
        program = folder / tool
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m {tool} "$@"\n')
        program.chmod(0o755)
    root = str(Path(__file__).resolve().parents[2])
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": root}


def completed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tool: str, *words: str) -> list[str]:
    """What bash is told that may stand in place of the last word."""
    monkeypatch.setenv(f"_{tool.upper()}_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", " ".join([tool, *words]))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    assert run_app(TOOLS[tool].app, tool, []) == 0
    return capsys.readouterr().out.split()


@pytest.mark.parametrize("tool", TOOLS)
def test_verbs_are_completed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tool: str) -> None:
    assert completed(capsys, monkeypatch, tool, "") == list(TOOLS[tool].VERBS)
    for verb in TOOLS[tool].VERBS:
        assert verb in completed(capsys, monkeypatch, tool, verb[:2])


@pytest.mark.parametrize(("tool", "verb"), VERBS)
def test_every_option_of_a_verb_is_completed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tool: str, verb: str
) -> None:
    found = set(completed(capsys, monkeypatch, tool, verb, "--"))
    params = TOOLS[tool].app.get_command(None, verb).params
    known = {
        option
        for param in params
        if param.param_type_name == "option" and not param.hidden
        for option in (*param.opts, *param.secondary_opts)
        if option.startswith("--")
    }
    assert known <= found
    assert "--help" in found


@pytest.mark.parametrize(
    ("tool", "words", "values"),
    [
        ("prf", ("export", "run", "--format", ""), ["geojson", "ros-map", "svg", "dxf", "netcdf"]),
        ("prf", ("prior", "--method", "e"), ["exact"]),
        ("prf", ("config", "c"), ["check"]),
        ("mapq", ("train", "--objective", "max"), ["max-margin"]),
        ("mapq", ("segment", "--color", "n"), ["never"]),
    ],
)
def test_values_of_a_choice_are_completed(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tool: str,
    words: tuple[str, ...],
    values: list[str],
) -> None:
    assert completed(capsys, monkeypatch, tool, *words) == values


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize(
    ("shell", "mark"),
    [
        ("bash", "complete -o default -F _{tool}_completion {tool}"),
        ("zsh", "#compdef {tool}"),
        ("fish", "complete --command {tool}"),
    ],
)
def test_the_script_of_each_shell_is_there(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tool: str, shell: str, mark: str
) -> None:
    monkeypatch.setenv(f"_{tool.upper()}_COMPLETE", f"source_{shell}")
    assert run_app(TOOLS[tool].app, tool, []) == 0
    assert mark.format(tool=tool) in capsys.readouterr().out


@pytest.mark.parametrize("tool", TOOLS)
def test_zsh_is_told_what_each_verb_does(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tool: str
) -> None:
    monkeypatch.setenv(f"_{tool.upper()}_COMPLETE", "complete_zsh")
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", f"{tool} ")
    assert run_app(TOOLS[tool].app, tool, []) == 0
    out = capsys.readouterr().out
    for verb, summary in TOOLS[tool].VERBS.items():
        assert f'"{verb}":"{summary.split()[0]} ' in out


@pytest.mark.parametrize("tool", TOOLS)
def test_bash_itself_completes_with_the_script(programs: dict[str, str], tool: str) -> None:
    verb = next(iter(TOOLS[tool].VERBS))
    script = ASK.format(tool=tool, variable=f"_{tool.upper()}_COMPLETE", words=f"{tool} {verb[:3]}", place=1)
    done = subprocess.run(["bash", "-c", script], env=programs, capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == ([verb], "")


@pytest.mark.parametrize("tool", TOOLS)
def test_show_completion_prints_the_script_of_the_shell_that_asks(programs: dict[str, str], tool: str) -> None:
    script = f"{tool} --show-completion; echo code $?"
    done = subprocess.run(["bash", "-c", script], env=programs, capture_output=True, text=True, check=False)
    assert f"complete -o default -F _{tool}_completion {tool}" in done.stdout
    assert done.stdout.endswith("code 0\n")


@pytest.mark.parametrize("tool", TOOLS)
def test_completion_imports_nothing_heavy(programs: dict[str, str], tool: str) -> None:
    code = f"""
import sys
from {tool}.cli import main
try:
    main([])
finally:
    print(*sorted({HEAVY!r} & set(sys.modules)), file=sys.stderr)
"""
    words = {f"_{tool.upper()}_COMPLETE": "complete_bash", "COMP_WORDS": f"{tool} inspect --", "COMP_CWORD": "2"}
    done = subprocess.run(
        [sys.executable, "-c", code], env={**programs, **words}, capture_output=True, text=True, check=False
    )
    assert "--json" in done.stdout.split()
    assert done.stderr == "\n"
