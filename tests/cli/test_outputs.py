"""What every verb does about its output: complete or not at all, never over an input, never over a file without -f."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from prf.shell.cli.outputs import exclusive
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


@pytest.mark.parametrize("name", ["out put", "\x1b[31mout", "out%s{0}"])
def test_odd_names_are_written_and_read(folder: Path, name: str) -> None:
    shutil.copy(folder / "laser.log", folder / f"{name}.log")
    assert call("prf info", folder, f"{name}.log", "-q").code == 0
    assert call("prf grid --laser", folder, f"{name}.log", "-o", f"{name}.npz", "-q").code == 0
    assert (folder / f"{name}.npz").exists()
