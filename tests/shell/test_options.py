from __future__ import annotations

import pytest

from prf.shell.cli.options import parse_duration


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90.0),
        ("0", 0.0),
        ("90s", 90.0),
        ("5m", 300.0),
        ("1.5h", 5400.0),
        (" 2M ", 120.0),
        ("1m30s", 90.0),
        ("1h30m", 5400.0),
        ("1e2", 100.0),
    ],
)
def test_durations(text: str, seconds: float) -> None:
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "m", "5d", "-1", "-1m", "inf", "nan", "1h30", "30m1h", "soon"])
def test_what_is_no_duration(text: str) -> None:
    with pytest.raises(ValueError, match="is no duration"):
        parse_duration(text)
