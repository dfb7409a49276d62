"""What every verb does about its output: complete or not at all, never over an input, never over a file without -f."""

from __future__ import annotations

import logging
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import prf
from prf.cli import app
from prf.readings import read_readings
from prf.shell.cli.outputs import exclusive
from prf.shell.cli.run import run_app
from tests.cli.calls import VERBS, Outcome, Verb, call, content, remove_outputs

WRITING = {verb.title: verb for verb in VERBS if verb.writes}


@contextmanager
def room_for(n_bytes: int) -> Iterator[None]:
    """Let no file grow beyond so many bytes: writing fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def check_refused(done: Outcome, folder: Path, before: dict[str, bytes]) -> None:
    assert (done.code, done.out, done.err.count("\n")) == (4, "", 1), done
    assert done.err.startswith("error: ")
    assert content(folder) == before


def target(verb: Verb) -> str:
    words = verb.call.split()
    return words[words.index("-o") + 1]


@pytest.mark.parametrize("verb", WRITING.values(), ids=WRITING)
class TestOutput:
    def test_it_is_kept_without_force(self, verb: Verb, folder: Path) -> None:
        path = folder / target(verb)
        if verb.writes[0].endswith("/"):
            path.mkdir()
            path /= "manifest.json"
        path.write_text("{}")
        before = content(folder)
        check_refused(call(verb.call, folder, "-q"), folder, before)

    def test_another_process_writes_it(self, verb: Verb, folder: Path) -> None:
        before = content(folder)
        with exclusive(folder / target(verb)):
            done = call(verb.call, folder, "-q")
        check_refused(done, folder, before)
        assert "another process" in done.err

    def test_it_is_no_input(self, verb: Verb, folder: Path) -> None:
        """Not even under --force."""
        before = content(folder)
        for name in verb.reads:
            if "/" not in name:
                done = call(verb.call.replace(f"-o {target(verb)}", f"-o {name}"), folder, "--force", "-q")
                assert (done.code in (2, 4), done.err.count("\n")) == (True, 1), done
                assert content(folder) == before


FULL = [
    pytest.param(verb, id=name, marks=[] if name.startswith(("prf grid", "mapq segment")) else pytest.mark.slow)
    for name, verb in WRITING.items()
]


@pytest.mark.parametrize("verb", FULL)
def test_a_full_disk_leaves_nothing(verb: Verb, copied: Path) -> None:
    assert call(verb.call, copied, "-q").code == 0
    files = [path for path in copied.rglob("*") if path.is_file() and "out" in str(path)]
    sizes = [path.stat().st_size for path in files if path.name != "posterior.png"]  # one that fails costs no draws
    remove_outputs(copied)
    before = content(copied)
    for room in {0, max(sizes) // 2}:
        with room_for(room):
            done = call(verb.call, copied, "-q")
        check_refused(done, copied, before)


@pytest.mark.parametrize(
    "command",
    [
        "prf prior --scale 1 --window 0 0 1 1 --draws 2 --method exact --seed 1 -o -",
        "prf export run --format geojson -o -",
        "prf render run -o -",
        "mapq segment cloud.ply -o -",
        "mapq train walls.patches -o -",
    ],
)
def test_dash_is_standard_output(folder: Path, command: str) -> None:
    before = content(folder)
    done = call(command, folder, "-q")
    assert (done.code, done.err) == (0, "")
    assert done.out
    assert content(folder) == before


@pytest.mark.parametrize(
    ("command", "name"),
    [
        ("prf query run --points FILE", "points.csv"),
        ("prf info FILE", "laser.log"),
        ("prf config show FILE", "set.toml"),
        ("mapq features FILE --csv", "walls.patches"),
        ("mapq inspect FILE", "cloud.ply"),
        ("mapq evaluate FILE --model model.json", "walls.patches"),
    ],
)
def test_dash_is_standard_input(folder: Path, command: str, name: str) -> None:
    done = call(command.replace("FILE", "-"), folder, "-q", stdin=(folder / name).read_bytes())
    assert (done.code, done.err) == (0, "")
    assert done.out
    assert not (folder / "-").exists()


@pytest.mark.parametrize("command", ["prf inspect -", "mapq report - -o out.html", "mapq label - --from-field truth"])
def test_what_needs_a_file_refuses_standard_input(folder: Path, command: str) -> None:
    done = call(command, folder, "-q")
    assert (done.code in (2, 3), done.out, done.err.count("\n")) == (True, "", 1), done


# Every verb on a bad input file: it reports one line that names the file, or does its whole work; never half of it.


FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "truncated": lambda data: data[: len(data) // 2],
    "another kind": lambda data: b"\x89PNG\r\n\x1a\n" + bytes(64),
}
CASES = {
    f"{verb.title}: {name}: {fault}": (verb, name, fault)
    for verb in VERBS
    for name in verb.reads
    for fault in ("missing", *FAULTS)
}


@pytest.mark.parametrize(("verb", "name", "fault"), CASES.values(), ids=CASES)
def test_a_bad_file_is_named_in_one_line(verb: Verb, name: str, fault: str, folder: Path) -> None:
    path = folder / name
    intact = path.read_bytes()
    try:
        if fault == "missing":
            path.unlink()
        else:
            path.write_bytes(FAULTS[fault](intact))
        before = content(folder)
        done = call(verb.call, folder, "-q")
        changed = {each for each, data in content(folder).items() if before.get(each) != data}
    finally:
        path.write_bytes(intact)
    if done.code == 0:
        assert all((folder / each).exists() for each in verb.writes)
        return
    errors = [line for line in done.err.splitlines() if line.startswith("error: ")]
    assert done.code in (1, 2, 3), done
    if "prf inspect run" not in verb.call:  # shows the state of every file of a RUN first
        assert done.err.splitlines() == errors, done.err
        assert done.out == ""
        assert len(errors) == 1, done.err
    assert changed == set()


def test_the_intact_files_are_read(folder: Path) -> None:
    for verb in VERBS:
        if not verb.writes:
            assert call(verb.call, folder, "-q").code == 0, verb.call


# What would spoil a map is warned of by the verbs that make one, a line each; a sane log is taken without a word.


SPOILING_VERBS = {
    "sample": ["-o", "out", "--chains", "1", "--steps", "10", "--seed", "1", "--scale", "0.001"],
    "anneal": ["-o", "out.geojson", "--chains", "1", "--steps", "10", "--seed", "1", "--scale", "0.001"],
    "grid": ["-o", "out.npz", "--resolution", "1", "--window", "-9", "-9", "999", "9"],
}
"""A small scale: a window of some kilometres, as millimetres taken for metres make it, has few edges then."""
SCALES = {
    "sane": (1.0, None),
    "millimetres": (1000.0, "are they in millimetres?"),
    "sonar": (1.0, "--sonar"),
}
"""Factor of the ranges; what is said of them."""


def write(path: Path, defect: str) -> str:
    far, _ = SCALES[defect]
    angles = np.linspace(-3.0, 3.0, 40)
    rows = [f"{0.2 * i},0,{a},{far * (1.5 + 0.1 * i)}" for i in range(4) for a in angles]
    cone = (",cone", ",0.349") if defect == "sonar" else ("", "")
    path.write_text("\n".join([f"x,y,theta,range{cone[0]}", *(row + cone[1] for row in rows)]) + "\n")
    return str(path)


@pytest.mark.parametrize("defect", SCALES)
@pytest.mark.parametrize("verb", SPOILING_VERBS)
def test_verbs_warn_once(verb: str, defect: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    words = [verb, "--laser", write(tmp_path / "a.csv", defect), *SPOILING_VERBS[verb]]
    for more in ([], ["-q"]):
        assert run_app(app, "prf", [*words, *more, "--force"]) == 0
        warned = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning:")]
        is_due = defect != "sane" and not more
        assert len(warned) == is_due, warned
        assert not is_due or SCALES[defect][1] in warned[0]


def test_python_callers_are_warned_too(tmp_path: Path, caplog) -> None:
    path = write(tmp_path / "a.csv", "millimetres")
    for readings in (path, read_readings(path)):
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger="prf"):
            prf.sample(
                readings, prf.Prior(0.001), chains=1, steps=10, seed=1, resolution=500.0, start="empty", progress=False
            )
        assert [record.levelname for record in caplog.records] == ["WARNING"]
        assert "millimetres" in caplog.text


@pytest.mark.parametrize("verb", ["sample", "anneal"])
def test_readings_of_which_no_memory_holds_maps_are_refused_with_what_to_do(
    verb, tmp_path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    log, end = write(tmp_path / "a.csv", "millimetres"), SPOILING_VERBS[verb][1]
    assert run_app(app, "prf", [verb, "--laser", log, "-o", end, "--scale", "1", "-q"]) == 3
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"error: {log}: the readings reach over 3")
    assert "Save ranges and poses in metres, or give --max-range, --window" in last
    wide = ["--window", "0", "0", "1e7", "1e7"]
    assert run_app(app, "prf", [verb, "--laser", log, "-o", end, *wide, "-q"]) == 2
    assert "error: --window: 10000000 x 10000000 m, of which no memory holds maps" in capsys.readouterr().err
