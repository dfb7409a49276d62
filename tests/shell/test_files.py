from __future__ import annotations

import errno
import gzip
import hashlib
import io
import os
import stat
from pathlib import Path
from typing import IO

import numpy as np
import pytest

from prf.shell.cli import files
from prf.shell.cli.storage import describe_input, describe_process, versions
from prf.shell.errors import InputError, OutputError


def print_and_fail(stream: IO[str]) -> None:
    stream.write("new")
    raise ZeroDivisionError


def write_group(group: files.Group, folder: Path) -> None:
    group.drop(folder / "link")
    for name in ("new", "a", "b"):
        with files.atomic_write(folder / name) as stream:
            stream.write("new")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


class TestAtomicWrite:
    def test_writes_text_and_bytes(self, tmp_path: Path) -> None:
        with files.atomic_write(tmp_path / "a.txt") as stream:
            stream.write("zwölf\n")
        with files.atomic_write(tmp_path / "b.bin", binary=True) as stream:
            stream.write(b"\x00\x01")
        assert (tmp_path / "a.txt").read_bytes() == "zwölf\n".encode()
        assert (tmp_path / "b.bin").read_bytes() == b"\x00\x01"
        assert names(tmp_path) == ["a.txt", "b.bin"]

    def test_failure_inside_keeps_the_old_file_and_leaves_nothing(self, tmp_path: Path) -> None:
        target = tmp_path / "a.txt"
        target.write_text("old")
        with pytest.raises(ZeroDivisionError), files.atomic_write(target) as stream:
            print_and_fail(stream)
        assert target.read_text() == "old"
        assert names(tmp_path) == ["a.txt"]

    def test_new_file_gets_the_mode_that_open_would_give(self, tmp_path: Path) -> None:
        (tmp_path / "plain").touch()
        with files.atomic_write(tmp_path / "atomic") as stream:
            stream.write("x")
        assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode

    def test_replaced_file_keeps_its_mode(self, tmp_path: Path) -> None:
        target = tmp_path / "a"
        target.touch(mode=0o600)
        with files.atomic_write(target) as stream:
            stream.write("x")
        assert stat.S_IMODE(target.stat().st_mode) == 0o600

    def test_follows_a_symbolic_link(self, tmp_path: Path) -> None:
        (tmp_path / "real").write_text("old")
        (tmp_path / "link").symlink_to("real")
        with files.atomic_write(tmp_path / "link") as stream:
            stream.write("new")
        assert (tmp_path / "link").is_symlink()
        assert (tmp_path / "real").read_text() == "new"

    def test_device_is_written_and_not_replaced(self) -> None:
        with files.atomic_write("/dev/null") as stream:
            stream.write("x")
        assert stat.S_ISCHR(os.stat("/dev/null").st_mode)

    def test_missing_folder_is_an_output_error_in_one_line(self, tmp_path: Path) -> None:
        with pytest.raises(OutputError, match="no such file or directory"), files.atomic_write(tmp_path / "no" / "a"):
            pytest.fail("entered the block")

    def test_folder_in_the_way_is_an_output_error(self, tmp_path: Path) -> None:
        (tmp_path / "a").mkdir()
        with pytest.raises(OutputError), files.atomic_write(tmp_path / "a") as stream:
            stream.write("x")
        assert names(tmp_path) == ["a"]


class TestStreams:
    def test_dash_reads_standard_input(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"abc")))
        with files.open_input("-") as stream:
            assert stream.read() == b"abc"

    def test_dash_writes_standard_output(self, capsysbinary: pytest.CaptureFixture[bytes]) -> None:
        with files.open_output("-", binary=True) as stream:
            stream.write(b"\x00")
        with files.open_output("-") as stream:
            stream.write("x")
        assert capsysbinary.readouterr().out == b"\x00x"

    def test_binary_to_a_terminal_is_refused(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(files, "is_terminal", lambda stream: True)
        with pytest.raises(OutputError, match="terminal"), files.open_output("-", binary=True):
            pytest.fail("entered the block")

    @pytest.mark.parametrize("name", ["absent", "."])
    def test_unreadable_input_is_an_input_error(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(InputError, match=r": (no such file or directory|is a directory)\."):
            files.open_input(tmp_path / name).__enter__()


def test_files_of_a_group_take_their_places_together(tmp_path: Path) -> None:
    for name in ("old", "last", "dropped"):
        (tmp_path / name).write_text("old")
    with files.together() as group:
        for name in ("first", "old", "last"):
            with files.atomic_write(tmp_path / name) as stream:
                stream.write("new")
        group.drop(tmp_path / "dropped")
        made = group.where(tmp_path / "last")
        assert made is not None
        assert (made.read_text(), (tmp_path / "last").read_text()) == ("new", "old")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == dict.fromkeys(
        ("first", "old", "last"), "new"
    )


def test_a_group_that_cannot_be_placed_leaves_all_old_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b", "dropped"):
        (tmp_path / name).write_text("old")
    (tmp_path / "link").symlink_to("dropped")
    replace = os.replace

    def fail(source: str | Path, target: Path) -> None:
        if str(source).endswith(".tmp") and target.name == "b":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        replace(source, target)

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OutputError, match=r"b: cannot be written"), files.together() as group:
        write_group(group, tmp_path)
    assert names(tmp_path) == ["a", "b", "dropped", "link"]
    assert {(tmp_path / name).read_text() for name in names(tmp_path)} == {"old"}


@pytest.mark.parametrize(("path", "name"), [("-", "standard input"), (os.devnull, os.devnull)])
def test_a_disk_that_fails_is_named(path: str, name: str) -> None:
    words = rf"^{name}: cannot be read \(connection timed out\)\.$"
    with pytest.raises(InputError, match=words), files.open_input(path):
        raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
    with pytest.raises(BrokenPipeError), files.open_input(path):
        raise OSError(errno.EPIPE, os.strerror(errno.EPIPE))


def test_folders_are_removed_where_they_are_not_needed(tmp_path: Path) -> None:
    with files.work_folder(tmp_path / "a") as work:
        Path(work, "tile").touch()
    with pytest.raises(ZeroDivisionError), files.made_folder(tmp_path / "new"):
        raise ZeroDivisionError
    with files.made_folder(tmp_path / "kept"):
        (tmp_path / "kept" / "a").touch()
    assert names(tmp_path) == ["kept"]


def test_what_ends_at_once_removes_its_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_temporary", {str(tmp_path / name) for name in ("work", "half.tmp", "gone")})
    (tmp_path / "work").mkdir()
    for name in ("work/tile", "half.tmp", "whole"):
        (tmp_path / name).touch()
    files.remove_all_temporary()
    assert names(tmp_path) == ["whole"]


def test_gzip_is_unpacked_and_its_damage_named() -> None:
    packed = gzip.compress(b"some text\n" * 1000)
    assert files.gunzip(packed + gzip.compress(b"more"), "a.gz").endswith(b"text\nmore")
    for data, words in (
        (packed[:-9], "cut off"),
        (packed[:20] + b"\xff" * 9, "damaged"),
        (packed + b"tail", "damaged"),
    ):
        with pytest.raises(InputError, match=f"a.gz: the gzip file is {words}"):
            files.gunzip(data, "a.gz")


def test_input_is_named_by_its_digest(tmp_path: Path) -> None:
    log = tmp_path / "a.log"
    log.write_bytes(b"FLASER 0\n")
    assert describe_input(log) == {
        "path": str(log),
        "sha256": hashlib.sha256(b"FLASER 0\n").hexdigest(),
        "bytes": 9,
    }


def test_a_folder_is_named_by_the_digests_of_its_files(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    unknown = {"path": str(bag), "sha256": None, "bytes": None}
    (bag / "inner").mkdir(parents=True)
    assert describe_input(bag) == unknown
    (bag / "inner").rmdir()
    assert describe_input(bag) == unknown, "it is empty"
    content = {"metadata.yaml": b"version: 9\n", "bag_0.mcap": b"12345"}
    for name, data in content.items():
        (bag / name).write_bytes(data)
    (bag / ".hidden").write_bytes(b"of a file browser")
    lines = "".join(f"{name} {hashlib.sha256(content[name]).hexdigest()}\n" for name in sorted(content))
    known = {"path": str(bag), "sha256": hashlib.sha256(lines.encode()).hexdigest(), "bytes": 16}
    assert describe_input(bag) == known
    (bag / "bag_0.mcap").rename(bag / "bag_1.mcap")
    other = describe_input(bag)
    assert (other["bytes"], other["sha256"] == known["sha256"]) == (16, False)
    (bag / "scans").mkdir()
    assert describe_input(bag) == unknown, "a digest of a part of it would mislead"


def test_standard_input_has_no_digest() -> None:
    assert describe_input("-") == {"path": "-", "sha256": None, "bytes": None}


def test_missing_input_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent"):
        describe_input(tmp_path / "absent")


def test_versions_are_those_that_run() -> None:
    assert versions()["numpy"] == np.__version__
    assert set(versions()) >= {"python", "numpy", "numba", "prf"}


def test_process_lists_its_inputs(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    described = describe_process([tmp_path / "a"])
    assert [entry["bytes"] for entry in described["inputs"]] == [0]
    assert described["platform"]["machine"]
