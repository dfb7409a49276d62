"""Results and tables beside an output which is standard output itself."""

import logging

import pytest

from prf.shell import streams
from prf.shell.errors import UsageError


def test_json_and_an_output_cannot_share_standard_output() -> None:
    with pytest.raises(UsageError, match="Name a file with -o"):
        streams.refuse_json_beside("-", json=True)
    streams.refuse_json_beside("maps.npz", json=True)
    streams.refuse_json_beside("-", json=False)
    streams.refuse_json_beside(None, json=True)


def test_a_table_leaves_standard_output_to_the_output_there(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with caplog.at_level(logging.INFO):
        streams.say_beside("-")("a line")
    assert capsys.readouterr().out == ""
    assert "a line" in caplog.text
    monkeypatch.setattr(streams.console.settings, "verbosity", 0)
    for output in ("maps.npz", None):
        streams.say_beside(output)("a line")
        assert capsys.readouterr().out == "a line\n"


def test_quiet_leaves_out_what_sums_up_a_file_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams.console.settings, "verbosity", -1)
    streams.say_beside("maps.npz")("a line")
    assert capsys.readouterr().out == ""
    streams.say_beside(None)("a line")
    assert capsys.readouterr().out == "a line\n"
