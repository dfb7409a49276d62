"""Every verb on files in odd places and under odd names: it works, or one line says what is wrong with which file."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.calls import ROOT, Said, call, call_as_nobody, call_words
from tests.fuzz.verbs import VERBS, Verb, make_samples, marked

NAMES = {
    "blank": "a b",
    "line": "a\nb",
    "dash": "-n",
    "format": "%s{0}",
    "colour": "\x1b[31m",
    "bytes": os.fsdecode(b"\xff\xfe"),
}
QUICK_NAMES = ("bytes",)
READING = [verb for verb in VERBS if verb.reads and "config check" not in verb.call]
"""All but the one whose answer to a bad file is no."""
PIPED = ("laser.log", "sonar.csv", "values.csv", "points.csv", "set.toml", "cloud.ply", "odometry.txt")
ROOM = 4 << 30
"""Bytes of address space for a verb that reads a device without end."""


@pytest.fixture(scope="module")
def samples() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "samples"
        folder.mkdir()
        make_samples(folder)
        for path in (folder.parent, folder):
            path.chmod(0o755)
        yield folder


@pytest.fixture
def folder(samples: Path) -> Iterator[Path]:
    """A folder with links to the samples that may be written by all."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        place.chmod(0o777)
        for path in samples.iterdir():
            (place / path.name).symlink_to(path)
        yield place


@pytest.fixture
def _reachable(folder: Path) -> None:
    """Skip where another user cannot reach `folder` at all."""
    if os.geteuid() == 0 and not all(parent.stat().st_mode & stat.S_IXOTH for parent in folder.parents):
        pytest.skip(f"needs a folder of temporary files that all users can reach, unlike {tempfile.gettempdir()}")


def own(folder: Path, name: str) -> Path:
    """Replace the link to a sample by nothing, and return its path."""
    (folder / name).unlink()
    return folder / name


def refused(said: Said, *names: str, codes: tuple[int, ...] = (2, 3)) -> None:
    assert said.code in codes, said
    assert (said.err.count("\n"), said.out) == (1, ""), said
    assert said.err.startswith("error: ")
    assert "internal" not in said.err
    assert any(name in said.err for name in names), said.err


EACH_INPUT = [(verb, name) for verb in READING for name in dict.fromkeys(verb.reads)]


def is_fine(verb: Verb, said: Said) -> bool:
    """Return whether a file of nothing may be read: settings may be empty."""
    return said.code == 0 and ".toml" in verb.call


@pytest.mark.parametrize(("verb", "name"), marked(EACH_INPUT))
def test_what_is_no_file_of_its_kind(verb: Verb, name: str, folder: Path) -> None:
    """Absent; a folder, or a file for one; empty; a link to itself; a device without content; one byte of NUL."""
    is_folder = name in ("run", "scans")
    path = own(folder, name)
    before = sorted(folder.iterdir())

    def tried(said: Said) -> None:
        if not is_fine(verb, said):
            refused(said, name)
        for made in folder.glob("out*"):
            assert is_fine(verb, said)
            shutil.rmtree(made) if made.is_dir() else made.unlink()
        path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
        assert sorted(folder.iterdir()) == before

    tried(call(verb.call, folder))
    path.mkdir()
    tried(call(verb.call, folder))
    for content in (b"", b"\0"):
        path.write_bytes(content)
        tried(call(verb.call, folder))
    for target in (name, "/dev/null"):
        path.symlink_to(target)
        tried(call(verb.call, folder))
    assert is_folder == (name in ("run", "scans"))


OVER_INPUTS = [(verb, name) for verb in VERBS if verb.writes for name in verb.reads if name not in ("run", "scans")]


@pytest.mark.parametrize(("verb", "name"), marked(OVER_INPUTS))
def test_an_input_is_never_the_output(verb: Verb, name: str, folder: Path) -> None:
    """Not even under --force: a slip would cost a log, or labels set by hand."""
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    words = verb.call.split()
    words[words.index("-o") + 1] = name
    refused(call_words([*words, "--force"], folder), name, "RESULT.ply", codes=(2, 4))
    assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


@pytest.mark.usefixtures("_reachable")
@pytest.mark.parametrize(("verb", "name"), marked(EACH_INPUT))
def test_a_file_that_may_not_be_read(verb: Verb, name: str, samples: Path, folder: Path) -> None:
    source, path = samples / name, own(folder, name)
    shutil.copytree(source, path) if source.is_dir() else shutil.copy(source, path)
    said = call_as_nobody(verb.call, folder, path, 0)
    refused(said, name)
    assert "ermission denied" in said.err
    assert not list(folder.glob("*out*"))


@pytest.mark.usefixtures("_reachable")
@pytest.mark.parametrize("verb", marked(verb for verb in VERBS if verb.writes))
def test_a_place_that_may_not_be_written(verb: Verb, folder: Path) -> None:
    refused(call_as_nobody(verb.call, folder, folder, 0o555), "out", codes=(4,))
    makes_folders = verb.writes[0].endswith(".run/") or verb.writes[0].endswith(".sim/")
    for place in ("absent/out", "laser.log/out", "/proc/out", "x" * 300)[makes_folders:]:
        refused(call(verb.call.replace("-o out", f"-o {place}"), folder), place, codes=(4,))
    assert not list(folder.glob("*out*"))
    assert not (folder / "absent").exists()


@pytest.mark.parametrize(
    "odd", [pytest.param(odd, marks=() if odd in QUICK_NAMES else pytest.mark.slow) for odd in NAMES]
)
@pytest.mark.parametrize("verb", marked(VERBS))
def test_odd_names(verb: Verb, odd: str, samples: Path, folder: Path) -> None:
    names = {
        name: NAMES[odd] + name
        for name in (*verb.reads, *(name.rstrip("/") for name in verb.writes))
        if name != "scans"
    }
    if "result.ply" in names:
        names["result.json"] = NAMES[odd] + "result.json"
    for old, new in names.items():
        if (folder / old).exists():
            (folder / old).rename(folder / new)
    if "bare.patches" in names:
        own(folder, names["bare.patches"])
        shutil.copy(samples / "bare.patches", folder / names["bare.patches"])
    words = [f"./{names[word]}" if word in names else word for word in verb.call.split()]
    said = call_words(words, folder)
    assert said.code == 0, said.err
    for name in verb.writes:
        assert (folder / names[name.rstrip("/")]).exists()


@pytest.mark.parametrize(
    "name", ["laser.log", "sonar.csv", "values.csv", "points.csv", "set.toml", "cloud.ply", "odometry.txt"]
)
def test_a_pipe_is_read_as_a_file(name: str, samples: Path, folder: Path) -> None:
    """As a shell gives one for ``<(zcat log.gz)``."""
    verb = next(verb for verb in READING if name in verb.reads and "check" not in verb.call)
    data, path = (samples / name).read_bytes(), own(folder, name)
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=(data,), daemon=True)
    writer.start()
    said = call(verb.call, folder)
    assert said.code == 0 or name == "cloud.ply", said.err
    writer.join(10.0)
    assert not writer.is_alive()


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="needs /dev/zero")
@pytest.mark.parametrize(("verb", "name"), marked(EACH_INPUT))
def test_a_device_without_end(verb: Verb, name: str, folder: Path) -> None:
    own(folder, name).symlink_to("/dev/zero")
    tool, *words = verb.call.split()
    code = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({ROOM}, {ROOM})); from {tool}.cli import main; "
    command = [sys.executable, "-c", code + f"main({[*words, '-q']!r})"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode in (2, 3), done
    assert (done.stderr.count("\n"), done.stdout) == (1, "")
    assert not list(folder.glob("*out*"))
