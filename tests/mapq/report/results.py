"""Results to report on, small and of known content."""

from __future__ import annotations

import re
from pathlib import Path

from mapq.patches import Patches
from mapq.results.result import assess
from tests.mapq.labelled import draw_patches
from tests.mapq.results.test_result import make_model


def save_result(path: Path, patches: Patches | None = None) -> Path:
    """Write what a small model says of walls, half of them doubled."""
    result = assess(draw_patches(1) if patches is None else patches, make_model())
    result.save(path, fail_over=0.05, force=True)
    return path


def without_scripts(page: str) -> str:
    """Return a page without its scripts."""
    return re.sub(r"<script>.*?</script>", "", page, flags=re.DOTALL)
