"""What every verb of both tools promises; a new verb is under test as soon as it stands in the table."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from prf.shell.run import run_app

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
VERBS = [(tool, verb) for tool, module in TOOLS.items() for verb in module.VERBS]
HEAVY = ("numpy", "numba", "scipy", "matplotlib", "shapely", "arviz_stats", "maxflow")
MISSING = "no-such-file.log"
PROBE = """
import sys
from {tool}.cli import main
try:
    main({args!r})
finally:
    print(*sorted(set({heavy!r}) & set(sys.modules)), file=sys.stderr)
"""


def call(tool: str, *args: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the tool as its own process, as a pipe sees it."""
    root = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    environment.pop("FORCE_COLOR", None)
    return subprocess.run(
        [sys.executable, "-m", tool, *args], capture_output=True, text=True, env=environment, cwd=cwd or root
    )


def verb_command(tool: str, verb: str):  # type: ignore[no-untyped-def] # typer's vendored click has no public type
    return TOOLS[tool].app.get_command(None, verb)


def missing_input_args(tool: str, verb: str) -> list[str]:
    """Return arguments that name a missing file wherever the verb asks for an input, and nothing else."""
    args = []
    for param in verb_command(tool, verb).params:
        if param.param_type_name == "argument" and param.required:
            args.append(MISSING)
    with_value = [param for param in verb_command(tool, verb).params if not getattr(param, "is_flag", False)]
    names = {option for param in with_value for option in param.opts}
    for option in ("--laser", "--points", "--map"):
        if option in names:
            args += [option, MISSING]
    return args


@pytest.mark.parametrize(
    ("line", "variable", "value", "message"),
    [
        ("prf simulate -o w", "PRF_SIMULATE_MAX_RANGE", "0", "max-range 0.0"),
        ("prf calibrate --laser no.log", "PRF_CALIBRATE_MAP", "floor.geojson", "floor.geojson: no such file"),
        ("prf grid --laser no.log", "PRF_GRID_RESOLUTION", "0", "--resolution 0.0"),
        ("mapq features no.patches", "MAPQ_FEATURES_FEATURES", "none", "--features"),
        ("mapq perturb . -o m.ply", "MAPQ_PERTURB_SCANS", "planes_*", "planes_*"),
    ],
)
def test_a_variable_has_the_name_of_its_option(line, variable, value, message, tmp_path, monkeypatch, capsys):
    """Whatever the parameter behind it is called."""
    tool, *words = line.split()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(variable, value)
    assert run_app(TOOLS[tool].app, tool, words) in (2, 3)
    assert message in capsys.readouterr().err


def test_the_tables_and_the_files_agree(project_root: Path) -> None:
    for tool, module in TOOLS.items():
        files = {path.stem for path in (project_root / tool / "commands").glob("[!_]*.py")}
        assert files == {verb.replace("-", "_") for verb in module.VERBS}


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_tool_help(tool: str, flag: str) -> None:
    done = call(tool, flag)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Exit codes:" in done.stdout
    for verb, summary in TOOLS[tool].VERBS.items():
        assert verb in done.stdout
        assert summary.split()[0] in done.stdout


@pytest.mark.parametrize("tool", TOOLS)
def test_tool_version(tool: str) -> None:
    assert call(tool, "--version").stdout == f"{tool} {prf.__version__}\n"


@pytest.mark.parametrize("tool", TOOLS)
def test_tool_help_imports_nothing_heavy(tool: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROBE.format(tool=tool, args=["--help"], heavy=HEAVY)], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "\n")


@pytest.mark.parametrize(("tool", "verb"), VERBS)
class TestVerb:
    def test_summary_is_the_first_line_of_its_help(self, tool: str, verb: str) -> None:
        assert verb_command(tool, verb).help.splitlines()[0] == TOOLS[tool].VERBS[verb]

    def test_help_has_examples_and_exit_codes(self, tool: str, verb: str) -> None:
        done = call(tool, verb, "--help")
        assert (done.returncode, done.stderr) == (0, "")
        examples = done.stdout.partition("Examples:")[2].partition("Exit codes:")[0]
        assert 1 <= examples.count(f"{tool} {verb} ") <= 4
        assert done.stdout == call(tool, verb, "-h").stdout

    def test_help_imports_nothing_heavy(self, tool: str, verb: str) -> None:
        code = PROBE.format(tool=tool, args=[verb, "--help"], heavy=HEAVY)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "\n")

    def test_every_option_has_help_and_examples_use_only_options_that_exist(self, tool: str, verb: str) -> None:
        params = verb_command(tool, verb).params
        assert [param.name for param in params if not param.help] == []
        known = {option for param in params for option in (*param.opts, *param.secondary_opts)}
        shown = call(tool, verb, "--help").stdout.partition("Examples:")[2].partition("Exit codes:")[0]
        calls = [re.split(r"[|>#]", line.partition(f"{tool} {verb} ")[2])[0] for line in shown.splitlines()]
        used = {word for line in calls for word in line.split() if re.match(r"--?[a-z]", word)}
        assert used <= known

    def test_unknown_flag_is_a_usage_error(self, tool: str, verb: str) -> None:
        done = call(tool, verb, "--no-such-flag")
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("\n") == 1

    def test_a_misspelt_option_is_answered_with_the_right_one(
        self, tool: str, verb: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        options = {option for param in verb_command(tool, verb).params for option in param.opts}
        for option in sorted(option for option in options if option.startswith("--")):
            assert run_app(TOOLS[tool].app, tool, [verb, f"{option}x"]) == 2
            assert option in capsys.readouterr().err.partition("Possible options:")[2]

    def test_colour_is_forced_or_left_out_as_the_environment_asks(
        self, tool: str, verb: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for variables, coloured in (({"FORCE_COLOR": "1"}, True), ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, False)):
            for name in ("FORCE_COLOR", "NO_COLOR"):
                monkeypatch.delenv(name, raising=False)
            for name, value in variables.items():
                monkeypatch.setenv(name, value)
            assert run_app(TOOLS[tool].app, tool, [verb, "--no-such-flag"]) == 2
            assert ("\x1b[" in capsys.readouterr().err) is coloured
            assert run_app(TOOLS[tool].app, tool, [verb, "--help"]) == 0
            assert "\x1b[" not in capsys.readouterr().out

    def test_missing_input_is_one_line(self, tool: str, verb: str, tmp_path: Path) -> None:
        args = missing_input_args(tool, verb)
        if not args:
            pytest.skip("the verb reads no file")
        done = call(tool, verb, *args, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (3, ""), done.stderr
        assert done.stderr.startswith("error: ")
        assert MISSING in done.stderr
        assert done.stderr.count("\n") == 1
        assert list(tmp_path.iterdir()) == [], "a failed start leaves nothing behind"

    def test_the_file_is_thin(self, tool: str, verb: str, project_root: Path) -> None:
        source = (project_root / tool / "commands" / f"{verb.replace('-', '_')}.py").read_text()
        functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
        bodies = {node.name: (node.end_lineno or 0) - node.body[0].lineno + 1 for node in functions}
        assert {name: lines for name, lines in bodies.items() if lines > 60} == {}
        assert "import numpy" not in source


def test_a_misspelt_verb_is_answered_with_the_right_one() -> None:
    for tool, verb in VERBS:
        done = call(tool, f"{verb}x")
        assert done.returncode == 2
        assert f"Did you mean '{verb}'" in done.stderr
