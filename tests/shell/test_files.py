from __future__ import annotations

import io
import os
import stat
from pathlib import Path
from typing import IO

import pytest

from prf.shell import files
from prf.shell.errors import InputError, OutputError


def write_and_fail(path: Path) -> None:
    path.write_text("new")
    raise ZeroDivisionError


def print_and_fail(stream: IO[str]) -> None:
    stream.write("new")
    raise ZeroDivisionError


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

    def test_dash_never_exists(self) -> None:
        assert files.refuse_existing("-", force=False) is None


class TestRefuseExisting:
    def test_a_folder_that_is_missing_or_no_folder_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        for place in ("no/such.txt", "file/such.txt"):
            with pytest.raises(OutputError, match="there is no folder"):
                files.refuse_existing(tmp_path / place, force=True)
            files.refuse_standing(tmp_path / place, force=False)
        with pytest.raises(OutputError, match="a folder is in the way"):
            files.refuse_existing(tmp_path, force=True)
        files.refuse_standing(tmp_path, force=True)

    def test_streams_devices_and_new_files_pass(self, tmp_path: Path) -> None:
        (tmp_path / "link").symlink_to("/dev/null")
        for place in ("-", "/dev/null", tmp_path / "link", tmp_path / "new"):
            files.refuse_existing(place, force=False)
