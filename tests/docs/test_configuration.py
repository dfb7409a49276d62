"""docs/configuration.md says of every key what the code says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import mapq.cli
import mapq.settings
from mapq.settings.asked import FLAGS
from mapq.settings.words import source_of as mapq_source_of
from prf.cli import app
from prf.sampler.asked import field_of, source_of
from prf.sampler.config import SampleConfig
from prf.settings_file import KEY_WORDS, TABLE_WORDS, TABLES


def documented(project_root: Path) -> dict[tuple[str, str], list[str]]:
    """Return the rows of the tables: unit, default, meaning and option of each key."""
    rows: dict[tuple[str, str], list[str]] = {}
    table = ""
    for line in (project_root / "docs" / "configuration.md").read_text().splitlines():
        if line.startswith("## "):
            table = line[3:].strip("[]")
        elif line.startswith("| `"):
            key, *rest = (cell.strip() for cell in line.strip("|").split("|"))
            rows[table, key.strip("`")] = rest
    return rows


def default_text(table: str, value: Any) -> str:
    return source_of(table) if value is None else repr(value)


def written(value: Any) -> str:
    """Return a value as TOML has it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(written, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


MAPQ_VERBS = {"segment": "segment", "features": "features", "crf": "train"}


def mapq_flags(table: str) -> set[str]:
    """Return the options of the verb whose table it is."""
    return {flag for param in mapq.cli.app.get_command(None, MAPQ_VERBS[table]).params for flag in param.opts}


def mapq_option(table: str, key: str) -> str:
    flag = FLAGS.get(key, "--" + key.replace("_", "-"))
    return f"`{flag}`" if flag in mapq_flags(table) else "–"


def test_every_key_of_mapq_is_documented_as_in_the_code(project_root: Path) -> None:
    rows = {place: row for place, row in documented(project_root).items() if place[0] in mapq.settings.TABLES}
    defaults = mapq.settings.defaults()
    assert list(rows) == [(table, key) for table, values in defaults.items() for key in values]
    for (table, key), (unit, default, meaning, option) in rows.items():
        words, value = mapq.settings.KEY_WORDS[f"{table}.{key}"], defaults[table][key]
        assert (unit, meaning) == (words.unit or "–", words.meaning), key
        assert default == (written(value) if value is not None else mapq_source_of(table, key)), key
        assert option == mapq_option(table, key), key


def prf_rows(project_root: Path) -> dict[tuple[str, str], list[str]]:
    return {place: row for place, row in documented(project_root).items() if place[0] in TABLES}


def test_every_key_is_documented_as_in_the_code(project_root: Path) -> None:
    config, rows = SampleConfig(), prf_rows(project_root)
    assert list(rows) == [(table, key) for table, content in TABLES.items() for key in content.keys]
    for (table, key), (unit, default, meaning, _) in rows.items():
        words = KEY_WORDS[f"{table}.{key}"]
        assert (unit, meaning) == (words.unit or "–", words.meaning), key
        assert default == default_text(table, getattr(config, field_of(table, key))), key


@pytest.mark.parametrize("verb", ["sample", "anneal"])
def test_options_are_those_of_the_verbs(project_root: Path, verb: str) -> None:
    flags = {flag for param in app.get_command(None, verb).params for flag in param.opts}
    for (table, key), (*_, option) in prf_rows(project_root).items():
        flag = "--" + field_of(table, key).replace("_", "-")
        assert option == (f"`{flag}`" if flag in flags else "–"), (table, key)


def test_every_table_and_key_has_words() -> None:
    assert set(TABLE_WORDS) == set(TABLES)
    assert set(KEY_WORDS) == {f"{table}.{key}" for table, content in TABLES.items() for key in content.keys}
