"""Running a reader on damaged files for a while: guided by coverage where atheris is installed, at random elsewhere."""

from __future__ import annotations

import importlib
import pkgutil
import random
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.fuzz.damage import damaged
from tests.fuzz.reader import Defect, Reader, little_room, try_reader

GUIDED = ("prf", "mapq", "rosbags", "laspy", "tomllib")
"""Packages whose branches guide the damage, ..."""
COMPILED = ("prf.kernels", "mapq.kernels")
"""... but for these, which numba could not compile then."""


@dataclass
class Record:
    """What a run came to: executions, CPU seconds, and the first file for each defect by its place."""

    executions: int = 0
    seconds: float = 0.0
    defects: dict[str, tuple[Defect, bytes]] = field(default_factory=dict)

    def note(self, defect: Defect | None, data: bytes) -> None:
        self.executions += 1
        if defect is not None:
            self.defects.setdefault(defect.place, (defect, data))


def run_plain(reader: Reader, seconds: float, seed: int = 0) -> Record:
    """Try damage at random, a file that was refused in a new way being damaged further."""
    record, rng = Record(), random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = prepared(reader, folder)
        if not files:
            return record
        begun = time.process_time()
        for data in files:
            record.note(_tried(reader, folder, data), data)
        while time.process_time() - begun < seconds:
            data = damaged(rng.choice(files), rng)
            record.note(_tried(reader, folder, data), data)
        record.seconds = time.process_time() - begun
    return record


def run_guided(
    reader: Reader, seconds: float, done: Callable[[Record], None], seed: int = 1, corpus: Path | None = None
) -> None:
    """Try damage that reaches new branches; it ends with `done`, which must end the process.

    Files that reached some are kept in `corpus`, and those that lie there already are damaged further.
    """
    import atheris

    record, rng = Record(), random.Random(seed)
    folder = Path(tempfile.mkdtemp())
    corpus = corpus or Path(tempfile.mkdtemp())
    corpus.mkdir(parents=True, exist_ok=True)
    for number, data in enumerate(prepared(reader, folder)):
        (corpus / f"whole-{number}").write_bytes(data)
        record.note(_tried(reader, folder, data), data)
    begun = time.process_time()

    def once(data: bytes) -> None:
        record.note(_tried(reader, folder, data), data)
        record.seconds = time.process_time() - begun
        if record.seconds > seconds:
            done(record)

    def mutated(data: bytes, largest: int, number: int) -> bytes:
        rng.seed(number)
        own = rng.random() < 0.6
        return damaged(data, rng, largest) if own else bytes(atheris.Mutate(data, largest))

    options = [
        "-verbosity=0",
        "-print_final_stats=0",
        "-max_len=65536",
        "-timeout=60",
        "-rss_limit_mb=0",  # atheris itself takes more and more; a read has little room of its own
        f"-seed={seed}",
        "-len_control=0",
    ]
    atheris.Setup([sys.argv[0], *options, f"-artifact_prefix={folder}/", str(corpus)], once, custom_mutator=mutated)
    atheris.Fuzz()


def _tried(reader: Reader, folder: Path, data: bytes) -> Defect | None:
    """Try a file in little room: beyond what the process has by now, as atheris itself takes more and more."""
    with little_room():
        return try_reader(reader, folder, data)


def prepared(reader: Reader, folder: Path) -> Sequence[bytes]:
    """Write what stands beside the file into `folder`, and return the whole files to begin from."""
    with tempfile.TemporaryDirectory() as aside:
        files = reader.seeds(Path(aside))
    reader.surround(folder)
    for data in files:  # what is imported and compiled on the way counts for no read
        try_reader(reader, folder, data)
    return files


def instrumented() -> Any:
    """Return the context in which packages are imported that guide, None without atheris."""
    try:
        import atheris
    except ImportError:
        return None
    for package in map(importlib.import_module, COMPILED):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    return atheris.instrument_imports(include=list(GUIDED), enable_loader_override=False)
