"""A dozen random moments, and signals; ``python -m tests.killed`` has a hundred."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.killed.__main__ import kill
from tests.killed.verbs import VERBS


@pytest.mark.slow
@pytest.mark.parametrize("signals", [False, True], ids=["SIGKILL", "SIGINT and SIGTERM"])
def test_killed_anywhere_nothing_is_half_written(tmp_path: Path, signals: bool) -> None:
    moments = kill(list(VERBS), 13, 2, tmp_path, signals)
    assert len(moments) == 13
    assert [moment for moment in moments if moment.faults or moment.state == "wrong"] == []
