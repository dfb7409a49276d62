"""Tests that become another user, in a clone that this user cannot reach."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_users_are_changed_in_a_private_clone_and_later_tests_pass_there(copied_project: Path) -> None:
    """As in root's home: the tests that change user in one process with others, in its order."""
    chosen = "(may_not and (info or (written and grid))) or (odd_names and info)"
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", "-k", chosen]
    # As plain Python: nothing has to be compiled for a copy that is used once.
    there = {**os.environ, "PYTHONPATH": str(copied_project), "NUMBA_DISABLE_JIT": "1"}
    words.append("tests/fuzz/test_places.py")
    done = subprocess.run(words, cwd=copied_project, env=there, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
    assert " passed" in done.stdout
