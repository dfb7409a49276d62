from __future__ import annotations

import io
from pathlib import Path

from prf.shell.cli.pictures import new_page, save


def test_letters_that_no_font_has_are_written_as_escapes(tmp_path: Path) -> None:
    page = new_page(2.0, 1.0)
    text = page.text(0.0, 0.5, "a\udce9 \x1b a\nb")
    save(page, io.BytesIO())
    save(page, tmp_path / "a.svg")
    assert text.get_text() == "a\\udce9 \\x1b a\nb"
