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
from tests.cli.calls import ONE_EACH, call, content
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


def test_a_verb_of_the_other_tool_leads_to_that_of_this_one(tmp_path: Path) -> None:
    done = call("mapq info map.ply", tmp_path)
    assert done.code == 2
    assert done.err == "error: No such command 'info'. Did you mean 'inspect'? See 'mapq --help'.\n"


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


# Mistakes that users make: each is answered by one line that names it, and leaves nothing behind.


LASER, SONAR = "--laser laser.log", "--sonar sonar.csv"
FIT = "prf calibrate --map room.geojson"
SIMULATE = "prf simulate -o out"
CLASSIFY = "mapq classify walls.patches --model model.json"
SAMPLE = f"prf sample {LASER} -o out"
PERTURB = "mapq perturb scans -o out.ply"
SETTINGS = (
    ("--config absent.toml", 3, "absent.toml: no such file"),
    ("--config bad.toml", 2, "bad.toml: [sonar] nose: unknown key. Did you mean noise?"),
    ("--config - --laser -", 2, "standard input can be read once only"),
    ("--topic /scan", 2, "--topic /scan"),
    ("--set readings.sonar_topic=/scan", 2, "is a table"),
    ("--frame odom", 2, "is a table"),
    ("--window 0 0 -1 1", 2, "window"),
)
"""Without an output, in which a verb would name one itself."""
CASES = (
    ("prf anneal", 2, "--laser"),
    ("prf anneal laser.log", 2, "--laser"),
    (f"prf anneal {LASER} --steps 1 --time-budget 1", 2, "one of them"),
    (f"prf anneal {LASER} -o - --json", 2, "standard output"),
    (f"prf anneal {LASER} --set sampler.temperatures=3", 2, "--set sampler.temperatures: not read here"),
    ("prf simulate --size 5 4 --pose-noise auto -o out", 2, "Give METRES RADIANS"),
    (f"prf calibrate {SONAR}", 2, "--map"),
    (FIT, 2, "--sonar"),
    (f"{FIT} {SONAR} --set sonar.max_range=-1", 2, "sonar.max_range"),
    (f"{FIT} {SONAR} --json -o -", 2, "standard output"),
    ("prf export run", 2, "no format"),
    ("prf export run -o out.txt", 2, "out.txt: its suffix names no format"),
    ("prf export run --format ros-map -o -", 2, "several files"),
    ("prf export run --format netcdf -o -", 2, "binary"),
    ("prf export run -o out.svg --unknown 0 1", 2, "--unknown is for"),
    ("prf export run -o out.nc --draw 1", 2, "--draw is for maps"),
    ("prf export run -o out.svg --draw 4", 2, "draws 0 to 3"),
    ("prf export run -o out.yaml --unknown 0.7 0.2", 2, "lower one first"),
    ("prf export run -o no/such/folder/a.svg", 4, "cannot be written"),
    (f"prf grid {LASER} -o out.npz --resolution 0", 2, "--resolution"),
    ("prf grid -o out.npz", 2, "--laser"),
    (f"prf grid {LASER} -o out.npz --set prior.scale=1 --set sampler.chains=2", 2, "not read here"),
    (f"prf grid {LASER} -o out.png", 2, "out.png"),
    ("prf prior --scale 1 --window 0 0 1 1 --draws 0", 2, "--draws"),
    ("prf prior --scale 1 --window 0 0 1 1 --draws 1 --thin 5", 2, "--thin"),
    ("prf prior --scale 1 --window 0 0 0 1 --draws 1", 2, "window"),
    ("prf query run", 2, "either --points"),
    ("prf query run --path points.csv", 2, "--radius"),
    ("prf query run --points points.csv --radius 1", 2, "--radius"),
    ("prf query run --points points.csv --square -1", 2, "square -1"),
    ("prf query run --path points.csv --radius nan", 2, "radius nan"),
    (f"prf sample {SONAR} --window 20 20 30 30 -o out", 3, "no sensor stands inside"),
    ("prf sample -o out", 2, "--sonar LOG"),
    ("prf sample --laser - --sonar - -o out", 2, "once"),
    ("prf sample --point-data - --laser - -o out", 2, "once"),
    ("prf sample --point-data values.csv --window 20 20 30 30 -o out", 3, "no point lies inside the window"),
    ("prf score run", 2, "--laser"),
    (f"prf score run {LASER} --noise 0", 2, "noise"),
    (f"prf score run {LASER} --square -1", 2, "square"),
    (f"prf score run {LASER} {SONAR} --pose-noise 0.1 0.1", 2, "no --sonar"),
    ("prf simulate", 2, "-o"),
    (f"{SIMULATE} --size 2 2", 2, "size"),
    (f"{SIMULATE} --scale 1", 2, "--scale is for --world arak"),
    (f"{SIMULATE} --no-laser", 2, "no sensor"),
    (f"{CLASSIFY} -o -", 2, "a cloud and a JSON"),
    (f"{CLASSIFY} -o out.json", 2, "a cloud and a JSON"),
    (f"{CLASSIFY} -o out/", 2, "name of a folder"),
    ("mapq segment cloud.ply -o out/", 2, "name of a folder"),
    (f"{CLASSIFY} -o out.ply --surfaces level", 2, "segmented already"),
    (f"{CLASSIFY} -o out.ply --unit ft", 2, "holds its unit"),
    (f"{CLASSIFY} -o out.ply --topic t", 2, "Leave out --topic"),
    (f"{CLASSIFY} -o no/such/folder/out.ply", 4, "does not exist). Make it first"),
    (f"{CLASSIFY} -o out.ply --fail-over 5", 2, "must be a share between 0 and 1 such as 0.05 or 5%"),
    (f"{CLASSIFY} -o out.copc.laz", 2, "COPC is not written"),
    ("mapq compare walls.patches walls.patches --model model.json --cell 0", 2, "must be a length"),
    ("mapq evaluate cloud.ply", 3, "neither PATCHES nor a result"),
    ("mapq evaluate walls.patches --model model.json --truth-field wrong", 3, "no point field wrong"),
    ("mapq evaluate result.ply --model model.json", 2, "Leave out --model"),
    ("mapq features walls.patches --csv --json", 2, "--json"),
    ("mapq inspect walls.patches --unit mm", 2, "holds its unit"),
    ("mapq render walls.patches --set cloud.topic=a -o out.png", 2, "Leave out cloud.topic"),
    ("mapq features walls.patches --set features.context=['colour']", 2, "features.context"),
    ("mapq render cloud.ply -o out.txt", 2, "out.txt"),
    ("mapq segment cloud.ply -o out.patches --set crf.folds=3", 2, "not read here"),
    ("mapq train walls.patches --set crf.tolerance=0.1", 2, "not read here"),
    ("mapq segment -", 2, "Name the output with -o"),
    ("mapq segment cloud.ply --surfaces round -o out.patches", 2, "--surfaces = "),
    *(
        (f"mapq {line} --config bad.toml", 2, "bad.toml: unknown table [sonar]")
        for line in ("segment cloud.ply", "features walls.patches", "train walls.patches", "classify walls.patches")
    ),
    ("mapq classify walls.patches --preset velodyne-vlp16 -o out.ply", 2, "preset velodyne-vlp16"),
    ("mapq simulate", 2, "-o"),
    ("mapq simulate -o out.ply --drift -1", 2, "drift = -1"),
    ("mapq simulate -o no/such/folder/out.ply", 4, "no/such/folder"),
    ("mapq train walls.patches -o out.json --set crf.regularisation=0", 2, "crf.regularisation = 0"),
    ("mapq train walls.patches -o out.json --set features.radius=-1", 2, "radius"),
    ("mapq train walls.patches --json -o -", 2, "both want standard output"),
    ("mapq train bare.patches -o out.json", 3, "mapq label"),
    (f"{SAMPLE} --window 3 0 1 1", 2, "window"),
    (f"{SAMPLE} --window 100 100 110 110", 3, "no sensor stands inside"),
    (f"{SAMPLE} --noise 0", 2, "noise"),
    (f"{SAMPLE} --resolution 1e-9", 2, "--resolution"),
    (f"{SAMPLE} --steps 10 --time-budget 1", 2, "one of them"),
    (f"{SAMPLE} --steps 10 my.log", 2, "(my.log). Did you mean --laser my.log?"),
    (f"{SAMPLE} --time-budget 1d", 2, "5m, 1.5h or 1h30m"),
    (f"{SAMPLE} --scans a:b", 2, "--scans"),
    (f"{SAMPLE} --every-scan 900 --pose-noise auto", 2, "too few scans to show how far poses err"),
    (f"{SAMPLE} --pose-noise much", 2, 'trajectory.pose_noise = "much"'),
    (f"{SAMPLE} --beam-angles -90:1:89", 2, "have directions of their own"),
    (f"{SAMPLE} --every-scan 1 --scans 900:901", 3, ""),
    (f"{SAMPLE} --set sampler.start=moon", 2, '--set sampler.start = "moon": must be'),
    (
        f"{SAMPLE} --set sampler.temperatures=3 --set sampler.tiles=4",
        2,
        "--set sampler.tiles: tempered chains have no tiles",
    ),
    (f"{SAMPLE} --set sampler.temperature=3", 2, "unknown key. Did you mean temperatures?"),
    (f"{SAMPLE} --set thinning.beam_density=-1", 2, "beam_density"),
    (f"prf anneal {LASER} -o out --set thinning.beam_density=nan", 2, "beam_density"),
    *(
        (f"prf {verb} {SONAR} {line}", code, words)
        for verb in ("sample", "anneal", "grid")
        for line, code, words in SETTINGS
    ),
    ("prf simulate -o out --no-laser --sonar --set simulate.beams=90", 2, "there is --no-laser"),
    ("mapq simulate -o out --size city --drift 0", 2, "--drift: not for --size city"),
    ("mapq simulate -o out --size city --n-points 1000", 2, "--n-points 1000"),
    ("mapq simulate -o - --size city", 2, "a city is a folder of tiles"),
    ("mapq classify cloud.ply --workers 0", 2, "--workers"),
    ("mapq classify cloud.ply --tile-points 9", 2, "--tile-points"),
    ("mapq classify cloud.ply --workers 2 --scheduler tcp://x:1", 2, "exclude one another"),
    ("mapq classify cloud.ply --workers 2 -o -", 2, "a cloud and a JSON"),
    ("mapq classify walls.patches --workers 2 -o out.ply", 2, "segmented already"),
    ("mapq label bare.patches --conservative", 2, "--from-field"),
    ("mapq label bare.patches --force", 2, "--from-field"),
    (
        "mapq label bare.patches --from-field truth --model m.json",
        2,
        "--model, --port and --no-browser are for the page",
    ),
    ("mapq label bare.patches --from-field truth --no-browser", 2, "--model, --port and --no-browser are for the page"),
    ("mapq label walls.patches --from-field wrong", 3, "walls.patches: no point field wrong"),
    ("mapq label walls.patches --from-field intensity", 3, "must be 0, 1 or 255"),
    ("prf export grid.npz --format geojson -o out", 3, "a grid has no polygons"),
    ("prf export grid.npz --format netcdf -o out", 3, "a grid has no chains"),
    ("prf export grid.npz --format ros-map --draw 0 -o out.yaml", 3, "a grid has no draws"),
    ("prf export grid.npz --format ros-map --squares -o out.yaml", 2, "a GRID has cells of"),
    ("prf export grid.npz --format ros-map --resolution 1 -o out.yaml", 2, "a GRID has cells of"),
    ("prf export room.geojson --format netcdf -o out", 3, "one map has no chains"),
    ("prf export room.geojson --format svg --draw 0 -o out", 3, "one map has no draws"),
    ("prf export room.geojson --format tum -o out", 3, "one map has no trajectory"),
    ("prf export run --format tum -o out", 3, "its poses were not sampled"),
    ("prf render grid.npz -o out.png --what best", 2, "GRID"),
    ("prf render grid.npz grid.npz -o out.png", 2, "GRID"),
    ("mapq perturb scans", 2, "-o"),
    ("mapq perturb scans -o -", 2, "-o MAP.ply"),
    ("mapq perturb scans -o out.json", 2, "-o"),
    ("mapq perturb scans -o out.e57", 2, "out.e57"),
    (f"{PERTURB} --offset -1", 2, "--offset"),
    (f"{PERTURB} --set scans.quaternion=abcd", 2, "quaternion"),
    ("mapq perturb scans/0.ply scans/1.ply -o out.ply --scans *.ply", 2, "--scans"),
    (f"{PERTURB} --yaw 1 --set scans.max_range=0.5", 3, "no point is left"),
    (f"{PERTURB} --poses no.txt", 3, "no.txt"),
    (f"{PERTURB} --reference no.txt", 3, "no.txt"),
    (f"{PERTURB} --scans b*", 3, "--scans"),
    (f"{PERTURB} --calibration calib.txt", 3, "calib.txt: no such file"),
    ("mapq perturb no-folder -o out.ply", 3, "no-folder"),
    ("mapq perturb scans scans -o out.ply", 3, "this is a folder"),
    ("mapq perturb scans -o no/such/map.ply", 4, "no/such"),
    ("mapq perturb scans/0.ply --poses scans/poses.txt -o scans/0.ply -f", 2, "is an input"),
    ("mapq perturb scans -o scans/0.ply -f", 2, "is an input"),
)


@pytest.mark.parametrize(("line", "code", "words"), CASES, ids=[line for line, _, _ in CASES])
def test_a_mistake_is_one_line(line: str, code: int, words: str, folder: Path) -> None:
    before = content(folder)
    done = call(line, folder, *([] if "--json" in line or "--csv" in line else ["-q"]))
    assert (done.code, done.out) == (code, ""), done
    assert done.err.count("\n") == 1, done.err
    assert words in done.err
    assert content(folder) == before
