"""Outputs are refused before any work: of another process, of another format, inputs, and those that exist."""

from __future__ import annotations

import errno
import fcntl
import subprocess
import sys
from pathlib import Path

import pytest

from prf.shell.cli.outputs import beside, claim_output, exclusive, refuse_existing, refuse_other_format, release_claims
from prf.shell.errors import OutputError, OutputExists, UsageError
from tests.cli.calls import call

HOLD = """
import sys
from prf.shell.cli.outputs import exclusive
with exclusive(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"


def test_an_output_without_a_name_lies_beside_its_input_or_here_where_it_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    assert beside("data/a.laz", "a.html") == "data/a.html"
    assert beside("data/run/", "run.html") == "data/run.html"
    assert beside("a.laz", "a.html") == beside("-", "a.html") == "a.html"
    monkeypatch.setattr("os.access", lambda path, mode: path != "data")
    assert beside("data/a.laz", "a.html") == "a.html"


def test_second_process_is_refused_and_a_killed_one_forgotten(run: Path, project_root: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(run)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=project_root,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match="another process"), exclusive(run):
            pytest.fail("entered the block")
        holder.kill()
        holder.wait()
        with exclusive(run):
            assert (run.parent / ".run.lock").exists()


def test_a_file_system_without_locks_is_written_with_a_warning(
    run: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    others = run.parent / ".run.abcd1234.tmp"
    others.touch()
    monkeypatch.setattr("fcntl.flock", refuse)
    with exclusive(run):
        assert caplog.messages == [f"{run}: cannot be locked here (no locks available). Let no other process write it."]
    assert list(run.parent.iterdir()) == [others], "another process may still be writing it"


def test_a_lock_file_that_its_holder_removed_meanwhile_is_made_anew(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lock, flock, calls = run.parent / ".run.lock", fcntl.flock, []

    def late(descriptor: int, operation: int) -> None:
        if not calls:
            lock.unlink()
        calls.append(descriptor)
        flock(descriptor, operation)

    monkeypatch.setattr("fcntl.flock", late)
    with exclusive(run):
        assert (len(calls), lock.exists()) == (2, True)


def test_it_is_released_without_a_trace_after_an_exception(run: Path) -> None:
    with pytest.raises(ZeroDivisionError), exclusive(run):
        raise ZeroDivisionError
    assert list(run.parent.iterdir()) == []


def test_unwritable_place_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"), exclusive(tmp_path / "file" / "run"):
        pytest.fail("entered the block")


def test_what_a_killed_process_left_is_removed_and_nothing_else(run: Path) -> None:
    kept = [run.parent / name for name in (".run.abcdefgh.keep", ".run2.abcdefgh.tmp", ".run.short.tmp", "run.tmp")]
    for path in (*kept, run.parent / ".run.abcdefgh.tmp"):
        path.touch()
    work = run.parent / ".run.ab_defg1.work"
    work.mkdir()
    (work / "tile.npz").touch()
    with exclusive(run):
        assert sorted(run.parent.iterdir()) == sorted([*kept, run.parent / ".run.lock"])


def test_a_claim_lasts_until_it_is_released(run: Path) -> None:
    claim_output(run, force=False)
    claim_output(run, force=False)
    with pytest.raises(OutputError, match="another process"), exclusive(run):
        pytest.fail("entered the block")
    release_claims()
    with exclusive(run):
        assert True
    assert list(run.parent.iterdir()) == []


def test_existing_outputs_inputs_and_bad_places_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(OutputExists):
        refuse_existing(file, force=False)
    with pytest.raises(UsageError, match="is an input"):
        claim_output(file, force=True, inputs=[None, "-", str(file)])
    for place in ("no/such.txt", "file/such.txt"):
        with pytest.raises(OutputError, match="does not exist"):
            refuse_existing(tmp_path / place, force=True)
        refuse_existing(tmp_path / place, force=False, is_folder=True)
    with pytest.raises(OutputError, match="is a folder, but a file is expected"):
        refuse_existing(tmp_path, force=True)
    refuse_existing(tmp_path, force=True, is_folder=True)


def test_streams_devices_and_new_files_pass(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("/dev/null")
    for place in ("-", "/dev/null", tmp_path / "link", tmp_path / "new"):
        claim_output(place, force=False)
    release_claims()
    assert not Path("/dev/.null.lock").exists()


def test_json_and_an_output_cannot_share_standard_output() -> None:
    with pytest.raises(UsageError, match="Name a file with -o"):
        claim_output("-", force=False, json=True)


@pytest.mark.parametrize(
    "line",
    [
        "prf anneal --laser LOG -o map.png",
        "prf grid --laser LOG -o grid.PNG",
        "prf prior --scale 1 --window 0 0 1 1 --draws 1 -o draws.svg",
        "prf calibrate --map LOG --laser LOG -o fit.yaml",
        "mapq segment LOG -o patches.ply",
        "mapq train LOG -o model.npz",
        "mapq classify LOG -o result.png",
        "mapq report LOG -o report.pdf",
    ],
)
def test_the_name_of_another_format_is_refused_at_once(line: str, tmp_path: Path) -> None:
    (tmp_path / "LOG").write_text("nothing that any verb reads\n")
    done = call(line, tmp_path)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith(f"error: {line.split()[-1]}: this format is not written. Name a .")
    assert [path.name for path in tmp_path.iterdir()] == ["LOG"]


@pytest.mark.parametrize("name", ["map.geojson", "MAP.GeoJSON", "map", "map.json", "map.v2", "-", "a.png/map"])
def test_other_names_are_taken(name: str) -> None:
    refuse_other_format(name, (".geojson",))
