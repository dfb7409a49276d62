"""No stale machine code, and no compiling twice: each claim seen from processes of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from prf.kernels import _jit
from prf.shell.jit import cache as kernel_cache

CALLEE = """
from toy.kernels._jit import jit

@jit
def factor() -> float:
    return {value}
"""
CALLER = """
from toy.kernels._jit import jit
from toy.kernels.callee import factor

@jit
def scaled(x: float) -> float:
    return factor() * x
"""
CALL = """
from toy.kernels._jit import CACHE
from toy.kernels.caller import scaled
value = scaled(11.0)
print(value, sum(scaled.stats.cache_hits.values()), CACHE.folder)
"""


@pytest.fixture
def kernels(tmp_path: Path) -> Path:
    """Return a kernel folder of two files with a copy of the project's `_jit.py`."""
    folder = tmp_path / "toy" / "kernels"
    folder.mkdir(parents=True)
    (tmp_path / "toy" / "__init__.py").touch()
    (folder / "__init__.py").touch()
    (folder / "_jit.py").write_bytes(Path(_jit.__file__).read_bytes())
    (folder / "callee.py").write_text(CALLEE.format(value=1.0))
    (folder / "caller.py").write_text(CALLER)
    return folder


def call(kernels: Path, **environment: str) -> tuple[float, int, Path]:
    """Call the caller in a new process: its value, its cache hits, and the folder that it used."""
    root = kernels.parents[1]
    project = Path(kernel_cache.__file__).parents[2]
    variables = {**os.environ, "PYTHONPATH": str(project), "PRF_CACHE_DIR": str(root / "cache"), **environment}
    done = subprocess.run(
        [sys.executable, "-c", CALL], cwd=root, env=variables, capture_output=True, text=True, check=True
    )
    value, hits, folder = done.stdout.split()
    return float(value), int(hits), Path(folder)


@pytest.mark.slow
def test_an_edited_callee_never_runs_stale_code(kernels: Path) -> None:
    assert call(kernels)[:2] == (11.0, 0)
    assert call(kernels)[:2] == (11.0, 1), "a second process must find the code of the first"
    (kernels / "callee.py").write_text(CALLEE.format(value=5.0))
    assert call(kernels)[:2] == (55.0, 0)
    (kernels / "callee.py").write_text(CALLEE.format(value=1.0))
    assert call(kernels)[:2] == (11.0, 1), "going back finds the older cache again"


@pytest.mark.slow
def test_bounds_checks_have_a_cache_of_their_own(kernels: Path) -> None:
    plain = call(kernels)[2]
    assert call(kernels, NUMBA_BOUNDSCHECK="1")[1:] != (1, plain)


@pytest.mark.slow
def test_an_unwritable_cache_folder_falls_back_to_one_that_works(kernels: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    blocked = str(tmp_path / "file" / "below")
    private = tmp_path / "tmp"
    private.mkdir()
    environment = {"PRF_CACHE_DIR": blocked, "XDG_CACHE_HOME": blocked, "TMPDIR": str(private)}
    value, _, folder = call(kernels, **environment)
    assert value == 11.0
    assert folder.is_relative_to(private / f"prf-kernels-{os.getuid()}")
    assert call(kernels, **environment)[:2] == (11.0, 1)
    assert not list(kernels.rglob("*.nbi")), "the kernel folder itself never holds machine code"


@pytest.mark.slow
def test_a_temporary_folder_that_others_may_write_is_not_trusted(kernels: Path, tmp_path: Path) -> None:
    private = tmp_path / "tmp"
    open_to_all = private / f"prf-kernels-{os.getuid()}"
    open_to_all.mkdir(parents=True)
    open_to_all.chmod(0o777)
    (tmp_path / "file").touch()
    blocked = str(tmp_path / "file" / "below")
    environment = {"PRF_CACHE_DIR": blocked, "XDG_CACHE_HOME": blocked, "TMPDIR": str(private)}
    value, _, folder = call(kernels, **environment)
    assert value == 11.0
    assert not folder.is_relative_to(open_to_all)
    assert list(private.iterdir()) == [open_to_all], "a folder for one process goes with it"


def test_old_caches_are_removed_and_strangers_stay(kernels: Path, tmp_path: Path) -> None:
    root = tmp_path / "cache"
    long_ago = time.time() - 2 * kernel_cache.PRUNE_AGE
    for number in range(12):
        (root / f"{number:016x}").mkdir(parents=True)
        os.utime(root / f"{number:016x}", (long_ago + number, long_ago + number))
    (root / "mine").mkdir()
    os.utime(root / "mine", (0, 0))
    current = call(kernels)[2]
    left = sorted(path.name for path in root.iterdir())
    newest = [f"{number:016x}" for number in range(12 - kernel_cache.KEPT_DIGESTS + 1, 12)]
    assert left == sorted([*newest, current.name, "mine"])


def test_other_users_of_numba_keep_their_cache_folder() -> None:
    config = vars(numba.config)
    before = config["CACHE_DIR"]

    @_jit.jit
    def one() -> float:
        return 1.0

    assert config["CACHE_DIR"] == before
    assert Path(one.stats.cache_path).is_relative_to(_jit.CACHE.folder)  # type: ignore[attr-defined]
