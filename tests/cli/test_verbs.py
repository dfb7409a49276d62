"""What every verb of both tools promises; a new verb is tested as soon as it is in the table of its tool."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from tests.cli.calls import ONE_EACH, call
from tests.conftest import ROOT

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
VERBS = [(tool, verb) for tool, module in TOOLS.items() for verb in module.VERBS]
HEAVY = ("numpy", "numba", "scipy", "matplotlib", "shapely", "arviz_stats", "maxflow")
MISSING = "no-such-file.log"
PROBE = """
import contextlib, io, sys
from prf.shell.cli.run import run_app
from {tool}.cli import VERBS, app
with contextlib.redirect_stdout(io.StringIO()):
    codes = [run_app(app, "{tool}", [*words, "--help"]) for words in ([], *([verb] for verb in VERBS))]
print(codes, sorted(set({heavy!r}) & set(sys.modules)))
"""
ASK = """
eval "$({variable}=source_bash {tool})"
COMP_WORDS=({tool} {start})
COMP_CWORD=1
_{tool}_completion {tool}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def command_of(tool: str, verb: str):  # type: ignore[no-untyped-def] # typer's vendored click has no public type
    return TOOLS[tool].app.get_command(None, verb)


def missing_input_args(tool: str, verb: str) -> list[str]:
    """Return arguments that name a missing file wherever the verb requires an input."""
    params = command_of(tool, verb).params
    args = [MISSING for param in params if param.param_type_name == "argument" and param.required]
    names = {option for param in params if not getattr(param, "is_flag", False) for option in param.opts}
    for option in ("--laser", "--points", "--map"):
        args += [option, MISSING] if option in names else []
    return args


def test_every_verb_has_its_file_and_its_call_below() -> None:
    for tool, module in TOOLS.items():
        files = {path.stem for path in (ROOT / tool / "commands").glob("[!_]*.py")}
        assert files == {verb.replace("-", "_") for verb in module.VERBS}
    assert set(ONE_EACH) == {f"{tool} {verb}" for tool, verb in VERBS}


@pytest.mark.parametrize("tool", TOOLS)
def test_help_imports_nothing_heavy(tool: str) -> None:
    code = PROBE.format(tool=tool, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout == f"{[0] * (1 + len(TOOLS[tool].VERBS))} []\n", done.stderr


@pytest.mark.parametrize("tool", TOOLS)
def test_a_tool_lists_its_verbs_and_its_version(tool: str, tmp_path: Path) -> None:
    listed = call(f"{tool} --help", tmp_path)
    assert (listed.code, listed.err) == (0, "")
    assert "Exit codes:" in listed.out
    assert [verb for verb, summary in TOOLS[tool].VERBS.items() if f"{verb} " not in listed.out] == []
    assert call(f"{tool} --version", tmp_path).out == f"{tool} {prf.__version__}\n"
    for verb in TOOLS[tool].VERBS:
        misspelt = call(f"{tool} {verb}x", tmp_path)
        assert (misspelt.code, f"Did you mean '{verb}'" in misspelt.err) == (2, True)


@pytest.mark.parametrize("tool", TOOLS)
def test_bash_completes_verbs(tool: str, tmp_path: Path) -> None:
    program = tmp_path / tool
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m {tool} "$@"\n')
    program.chmod(0o755)
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    verb = next(iter(TOOLS[tool].VERBS))
    script = ASK.format(tool=tool, variable=f"_{tool.upper()}_COMPLETE", start=verb[:3])
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == ([verb], "")


@pytest.mark.parametrize("verb", sorted(set(prf.cli.VERBS) - {"config"}))
def test_an_answer_has_15_lines_at_most(verb: str, folder: Path) -> None:
    """What is a file of its own has as many as it needs: settings, or a table of answers."""
    done = call(ONE_EACH[f"prf {verb}"].call, folder)
    assert (done.code, len(done.out.splitlines()) <= 15) == (0, True), done.out


@pytest.mark.parametrize(("tool", "verb"), VERBS)
class TestVerb:
    def test_help_has_summary_examples_and_exit_codes(self, tool: str, verb: str, tmp_path: Path) -> None:
        shown = call(f"{tool} {verb} --help", tmp_path)
        assert (shown.code, shown.err) == (0, "")
        assert command_of(tool, verb).help.splitlines()[0] == TOOLS[tool].VERBS[verb]
        examples = shown.out.partition("Examples:")[2].partition("Exit codes:")[0]
        assert 1 <= examples.count(f"{tool} {verb} ") <= 4
        params = command_of(tool, verb).params
        assert [param.name for param in params if not param.help] == []
        known = {option for param in params for option in (*param.opts, *param.secondary_opts)}
        lines = [re.split(r"[|>#]", line.partition(f"{tool} {verb} ")[2])[0] for line in examples.splitlines()]
        assert {word for line in lines for word in line.split() if re.match(r"--?[a-z]", word)} <= known
        assert shown.out == call(f"{tool} {verb} -h", tmp_path).out

    def test_a_wrong_option_is_a_usage_error(
        self, tool: str, verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv("FORCE_COLOR", raising=False)
        done = call(f"{tool} {verb} --jsonx", tmp_path)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
        assert done.err.startswith("error: ")
        options = {option for param in command_of(tool, verb).params for option in param.opts}
        assert ("--json" in done.err.partition("Possible options:")[2]) == ("--json" in options)
        monkeypatch.setenv("FORCE_COLOR", "1")
        assert "\x1b[" in call(f"{tool} {verb} --jsonx", tmp_path).err
        monkeypatch.setenv("NO_COLOR", "1")
        assert "\x1b[" not in call(f"{tool} {verb} --jsonx", tmp_path).err

    def test_a_missing_input_is_one_line(self, tool: str, verb: str, tmp_path: Path) -> None:
        args = missing_input_args(tool, verb)
        if args:
            done = call(f"{tool} {verb}", tmp_path, *args)
            assert (done.code, done.out, done.err.count("\n")) == (3, "", 1), done
            assert done.err.startswith("error: ")
            assert MISSING in done.err
            assert list(tmp_path.iterdir()) == [], "a failed start leaves nothing behind"

    def test_quiet_and_json(self, tool: str, verb: str, folder: Path) -> None:
        """Quiet, a verb that writes a file prints nothing; with --json every verb prints one object or writes it."""
        one = ONE_EACH[f"{tool} {verb}"]
        done = call(one.call, folder, "-q")
        assert (done.code, done.err) == (0, "")
        assert (done.out == "") == bool(one.writes or verb == "label"), done.out
        if "--json" in {option for param in command_of(tool, verb).params for option in param.opts}:
            words = [word for word in one.call.split() if word != "--csv"]
            done = call(
                " ".join(words), folder, "--json", "-q", *(["--force"] if one.writes or verb == "label" else [])
            )
            assert (done.code, done.err) == (0, "")
            assert json.loads(done.out)["schema"].startswith(tool)

    def test_the_file_is_thin(self, tool: str, verb: str) -> None:
        source = (ROOT / tool / "commands" / f"{verb.replace('-', '_')}.py").read_text()
        functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
        bodies = {node.name: (node.end_lineno or 0) - node.body[0].lineno + 1 for node in functions}
        assert {name: lines for name, lines in bodies.items() if lines > 60} == {}
        assert "import numpy" not in source
