"""Every reader on files in which one value after the other is exchanged: whole numbers without end, nothing, lists."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz.reader import try_reader
from tests.fuzz.readers import READERS
from tests.fuzz.run import prepared
from tests.fuzz.values import exchanged


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_no_value_breaks_a_reader(name: str, tmp_path: Path) -> None:
    reader = READERS[name]
    defects = {}
    for whole in prepared(reader, tmp_path):
        for data in exchanged(whole):
            defect = try_reader(reader, tmp_path, data)
            if defect is not None:
                defects.setdefault(defect.place, (defect.what, data[:2000]))
    assert defects == {}


def test_values_of_a_text_are_exchanged() -> None:
    given = set(exchanged(b'{"a": [1, -2.5e3], "b": true}\n'))
    assert b'{"a": [1, null], "b": true}\n' in given
    assert b'{"a": [1, -2.5e3], "b": []}\n' in given
    assert b'{"x": [1, -2.5e3], "b": true}\n' in given
    assert len(given) > 60
