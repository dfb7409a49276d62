"""Fixtures that every test may use, and hypothesis settings fit for compiled code."""

from __future__ import annotations

import logging
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from prf.sampler import schedules

ROOT = Path(__file__).resolve().parent.parent

# Threads of OpenMP and BLAS that wait for each other spin: on small data, beside another worker, ten times the time.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

os.environ["BROWSER"] = "true"  # a page that a verb opens must not come up

# A first call compiles for seconds, so no deadline; examples are derived from the test, so that a red run repeats.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

# What a script starts with & ignores Ctrl-C, and so would all that the tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def _loggers_of_no_verb() -> None:
    """Put the packages' loggers back: a verb that ran in this process keeps their messages from `caplog`."""
    for name in ("prf", "mapq"):
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.setLevel(logging.NOTSET)
        logger.propagate = True


@pytest.fixture(scope="module", autouse=True)
def _early_regions(request: pytest.FixtureRequest) -> Iterator[None]:
    """Step in regions from the first step where the sampler is held to laws and to itself: those chains are short."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name in ("sampler", "statistical", "poses"):
            patch.setattr(schedules, "WHOLE", 0)
        yield


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Return the folder that holds pyproject.toml."""
    return ROOT


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Return the folder of the small inputs that travel with the project."""
    return ROOT / "data"


@pytest.fixture
def copied_project(tmp_path: Path) -> Path:
    """Return a copy of the project in a folder that its owner alone may enter: the packages and their tests."""
    folder = tmp_path / "private"
    folder.mkdir(mode=0o700)
    for name in ("prf", "mapq", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of public logs beside the project, or skip: they do not travel with it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("needs the public logs beside the project")
    return folder
