"""``-`` is standard input wherever a verb reads one file, and standard output wherever it writes one for others."""

from __future__ import annotations

import io
import shlex
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import mapq.cli
import prf.cli
from mapq.io import write_patches, write_ply
from mapq.io.models import write_model
from prf.run import write_run
from prf.shell.run import run_app
from tests.factories import make_run
from tests.mapq.assess.test_result import make_model
from tests.mapq.labelled import draw_patches

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
READINGS = "x,y,theta,range\n" + "".join(f"5,5,{angle:.2f},3\n" for angle in np.arange(0.0, 6.2, 0.3))
LITTLE = "--max-range 8 --chains 1 --steps 20 --seed 1"


class Read(NamedTuple):
    """A command that reads a file of the folder, named FILE in it.

    Attributes
    ----------
    command : str
    file : str
    same : bool
        Whether it prints the same from a file as from standard input: messages and JSON name what was read.
    """

    command: str
    file: str
    same: bool = True


READS = {
    "prf sample": Read(f"sample --laser FILE {LITTLE} --resolution 2 -o sampled -f -q", "log.csv", same=False),
    "prf anneal": Read(f"anneal --laser FILE {LITTLE} -o -", "log.csv", same=False),
    "prf info": Read("info FILE", "log.csv", same=False),
    "prf query": Read("query run --points FILE", "points.csv"),
    "prf config": Read("config show FILE", "settings.toml", same=False),
    "prf grid": Read("grid --laser FILE --max-range 8 -o grid.npz -f", "log.csv", same=False),
    "prf score": Read("score run --laser FILE --max-range 8 --seed 1", "log.csv", same=False),
    "prf calibrate": Read("calibrate --laser FILE --max-range 8 --map plan.geojson -o -", "log.csv", same=False),
    "prf render": Read("render FILE -o -", "draws.geojsonl", same=False),
    "prf simulate": Read("simulate --path FILE --world plan.geojson --seed 1 -o world -f", "path.csv", same=False),
    "mapq config": Read("config show FILE", "mapq.toml", same=False),
    "mapq segment": Read("segment FILE -o cut.patches -f", "cloud.ply", same=False),
    "mapq train": Read("train FILE -o -", "map.patches", same=False),
    "mapq classify": Read("classify FILE --model model.json -o result.ply -f", "map.patches", same=False),
    "mapq compare": Read("compare FILE map.patches --model model.json", "map.patches", same=False),
    "mapq evaluate": Read("evaluate FILE --model model.json", "map.patches", same=False),
    "mapq features": Read("features FILE --csv", "map.patches"),
    "mapq render": Read("render FILE -o -", "map.patches", same=False),
    "mapq inspect": Read("inspect FILE", "map.patches", same=False),
}
REFUSED = {
    "prf inspect": ("inspect -", "-"),
    "prf export": ("export - --format svg -o -", "-"),
    "mapq report": ("report -", "standard input"),
    "mapq label": ("label - --from-field truth", "standard input"),
    "mapq perturb": ("perturb - -o out.ply", "-"),
}
"""Verbs that read folders, or several files at once, or change the file: one line, which names what was wrong."""
NO_INPUT = {"prf prior", "mapq simulate"}
WRITES = (
    "prf prior --scale 1 --window 0 0 1 1 --draws 2 --method exact --seed 1 -o -",
    "prf export run --format geojson -o -",
    "prf export run --format svg -o -",
    "prf render run -o -",
    "mapq segment cloud.ply -o -",
    "mapq train map.patches -o -",
    "mapq render map.patches -o -",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("streams")
    write_run(path / "run", make_run(n_draws=5))
    (path / "log.csv").write_text(READINGS)
    (path / "points.csv").write_text("x,y\n1,2\n")
    (path / "path.csv").write_text("x,y\n3,3\n7,3\n")
    (path / "settings.toml").write_text("[prior]\nscale = 0.2\n")
    (path / "mapq.toml").write_text("[segment]\nneighbours = 12\n")
    square = "[[[0,0],[10,0],[10,10],[0,10],[0,0]],[[1,1],[1,9],[9,9],[9,1],[1,1]]]"
    (path / "plan.geojson").write_text(
        f'{{"type":"Feature","properties":{{"window":[-1,-1,11,11]}},"geometry":{{"type":"Polygon","coordinates":{square}}}}}'
    )
    prior = f"prior --scale 1 --window 0 0 1 1 --draws 2 --method exact --seed 1 -o {path / 'draws.geojsonl'}"
    assert run_app(prf.cli.app, "prf", prior.split()) == 0
    write_patches(path / "map.patches", draw_patches(1))
    write_ply(path / "cloud.ply", draw_patches(1).cloud)
    write_model(path / "model.json", make_model())
    return path


def call(
    capsysbinary: pytest.CaptureFixture[bytes],
    monkeypatch: pytest.MonkeyPatch,
    tool: str,
    command: str,
    data: bytes = b"",
) -> tuple[int, bytes, bytes]:
    """Return exit code, standard output and standard error of a command with `data` on its standard input."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    code = run_app(TOOLS[tool].app, tool, shlex.split(command))
    return code, *capsysbinary.readouterr()


def test_every_verb_is_here() -> None:
    verbs = {f"{tool} {verb}" for tool, module in TOOLS.items() for verb in module.VERBS}
    assert verbs == set(READS) | set(REFUSED) | NO_INPUT


@pytest.mark.parametrize("verb", READS)
def test_standard_input_is_read_like_a_file(
    folder: Path, capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    monkeypatch.chdir(folder)
    tool, case = verb.split()[0], READS[verb]
    outputs = []
    for name, data in ((case.file, b""), ("-", (folder / case.file).read_bytes())):
        code, out, err = call(capsysbinary, monkeypatch, tool, case.command.replace("FILE", name), data)
        assert code == 0, err
        outputs.append(out)
    assert not (folder / "-").exists()
    assert (outputs[0] == outputs[1]) or not case.same
    assert [len(out) > 0 for out in outputs] in ([True, True], [False, False])


@pytest.mark.parametrize("verb", REFUSED)
def test_what_cannot_be_read_from_a_pipe_is_refused(
    folder: Path, capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    monkeypatch.chdir(folder)
    command, word = REFUSED[verb]
    code, out, err = call(capsysbinary, monkeypatch, verb.split()[0], command)
    assert (code in (2, 3), out) == (True, b"")
    assert err.startswith(b"error: ")
    assert (err.count(b"\n"), word.encode() in err) == (1, True)


@pytest.mark.parametrize("command", WRITES)
def test_the_result_goes_to_standard_output_and_nothing_else_does(
    folder: Path, capsysbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(folder)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    tool, _, arguments = command.partition(" ")
    code, out, _ = call(capsysbinary, monkeypatch, tool, arguments)
    assert code == 0
    assert out.startswith((b"{", b"<?xml", b"<svg", b"\x89PNG", b"ply\n", b"PK"))
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
