from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from prf.shell.errors import OutputError
from prf.shell.lock import claim_output, exclusive, release_claims

HOLD = """
import sys
from prf.shell.lock import exclusive
with exclusive(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"


def test_a_second_process_is_refused_with_the_holder_named(run: Path, project_root: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(run)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=project_root,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match=f"pid {holder.pid}"), exclusive(run):
            pytest.fail("entered the block")
        holder.kill()
        holder.wait()
        with exclusive(run):
            assert (run.parent / ".run.lock").exists(), "a killed holder must not keep the output locked"


def test_no_lock_file_is_left(run: Path) -> None:
    with exclusive(run):
        pass
    assert list(run.parent.iterdir()) == []


def test_released_after_an_exception(run: Path) -> None:
    with pytest.raises(ZeroDivisionError), exclusive(run):
        raise ZeroDivisionError
    with exclusive(run):
        assert True


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


def test_streams_and_devices_are_nobodys() -> None:
    for name in ("-", "/dev/null"):
        claim_output(name, force=False)
    assert not Path("/dev/.null.lock").exists()
