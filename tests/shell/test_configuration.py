"""Settings files: what presets, a file and its checks come to, whatever the tool."""

from __future__ import annotations

from pathlib import Path

import pytest

import mapq.settings
import prf.settings_file
from prf.shell.configuration import (
    Array,
    Flag,
    Kind,
    Number,
    Schema,
    Whole,
    Word,
    Words,
    preset_names,
    problems_of,
    read_preset,
    settings_from,
)
from prf.shell.errors import ConfigError

SCHEMAS = {"prf": prf.settings_file.SCHEMA, "mapq": mapq.settings.SCHEMA}
PRESETS = [(tool, name) for tool, schema in SCHEMAS.items() for name in preset_names(schema)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "site.toml"


@pytest.mark.parametrize(
    ("kind", "value", "read"),
    [
        (Number(), 1, 1.0),
        (Whole(), 16.0, 16),
        (Flag(), True, True),
        (Array(2), [1, 2.5], (1.0, 2.5)),
        (Word(("a", "b")), "b", "b"),
        (Words(), ["x", "y"], ("x", "y")),
        (Words(("a", "b")), [], ()),
    ],
)
def test_a_kind_reads_its_values(kind: Kind, value: object, read: object) -> None:
    found = kind.read(value)
    assert found == read
    assert type(found) is type(read)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Number(), ["1", True, None, float("nan"), float("inf"), [1], 10**400]),
        (Whole(), [1.5, False, "1", float("inf"), 1e300]),
        (Flag(), [1, "true"]),
        (Array(2), [[1], [1, 2, 3], 1, "ab", [1, "b"], [1, True]]),
        (Word(("a", "b")), ["c", 1, ["a"]]),
        (Words(), ["x", [1], {"x": 1}]),
        (Words(("a",)), [["a", "c"]]),
    ],
)
def test_a_kind_refuses_all_others(kind: Kind, values: list[object]) -> None:
    for value in values:
        with pytest.raises(ValueError, match=r"\w"):
            kind.read(value)


@pytest.mark.parametrize(("tool", "name"), PRESETS)
def test_every_preset_is_sound_and_says_where_its_values_come_from(tool: str, name: str, project_root: Path) -> None:
    preset = read_preset(name, SCHEMAS[tool])
    assert preset.title
    assert preset.tables
    lines = [line for line in preset.text.splitlines() if "=" in line.partition("#")[0]]
    assert sum(len(values) for values in preset.tables.values()) == len(lines)
    said = " ".join(line.partition("#")[2] for line in lines)
    assert "data sheet: " in said, "a preset without a figure of its maker is a guess"
    page = (project_root / "docs" / "presets.md").read_text()
    assert f"`{name}`" in page


@pytest.mark.parametrize(("tool", "name"), PRESETS)
def test_a_preset_changes_something(tool: str, name: str) -> None:
    """But for the ring's, which writes down the defaults that were made for it."""
    if tool == "prf":
        from prf.sampler.asked import settings_of
        from prf.sampler.config import SampleConfig

        defaults = settings_of(SampleConfig())
    else:
        defaults = mapq.settings.defaults()
    tables = read_preset(name, SCHEMAS[tool]).tables
    same = all(defaults[table].get(key) == value for table, values in tables.items() for key, value in values.items())
    assert same == (name == "pioneer-ring")


def test_the_file_wins_over_its_preset_and_names_its_sources(file: Path) -> None:
    file.write_text('preset = "hokuyo-urg-04lx"\n[laser]\nnoise = 0.05\n')
    found = settings_from(file, (), SCHEMAS["prf"])
    assert found.tables == {"laser": {"max_range": 4.0, "noise": 0.05, "noise_relative": 0.01}}
    assert found.places["laser"]["noise"] == f"{file}: [laser] noise"
    assert found.places["laser"]["max_range"] == "preset hokuyo-urg-04lx: [laser] max_range"
    assert found.presets == ("hokuyo-urg-04lx",)


def test_presets_that_are_asked_for_take_the_place_of_the_files(file: Path) -> None:
    file.write_text('preset = ["hokuyo-urg-04lx"]\n[laser]\nnoise = 0.05\n')
    found = settings_from(file, ["sick-lms111", "pioneer-ring"], SCHEMAS["prf"])
    assert found.tables["laser"] == {"max_range": 20.0, "noise": 0.05}
    assert found.tables["sonar"]["cone"] == 0.349
    assert found.presets == ("sick-lms111", "pioneer-ring")


def test_nothing_asked_is_nothing_set() -> None:
    assert settings_from(None, (), SCHEMAS["prf"]).tables == {}


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("preset = 'sick-lms20'\n", 1, "there is no preset 'sick-lms20'. Did you mean sick-lms200"),
        ("# site\npreset = 'kinect'\n", 2, "Known are hokuyo-urg-04lx, "),
        ("preset = 7\n", 1, "must be the name of a preset, or an array of names"),
        ("preset = [1]\n", 1, "must be the name of a preset"),
        ("[preset]\nname = 'sick-lms200'\n", 1, "must be the name of a preset"),
        ("preset = ['sick-lms200', 'sick-lms111']\n", 1, "presets sick-lms200 and sick-lms111 both set [laser]"),
        ("presets = 'sick-lms200'\n", 1, "stands outside the tables. Move it into its table. Did you mean preset?"),
        ("sonar = { cone = 9 }\n", 1, "[sonar] cone 9.0: must lie between 0 and pi"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_presets_is_told_with_its_line(file: Path, text: str, line: int, words: str) -> None:
    file.write_text(text)
    problems = problems_of(file, SCHEMAS["prf"])
    assert len(problems) == 1
    assert problems[0].startswith(f"{file}:{line}: ")
    assert words in problems[0]
    with pytest.raises(ConfigError) as caught:
        settings_from(file, (), SCHEMAS["prf"])
    assert str(caught.value) == problems[0]


@pytest.mark.parametrize("text", ["[[laser]]\nnoise = 1\n", "laser = 1\n", "laser = [1]\n"])
def test_a_table_is_written_as_one(file: Path, text: str) -> None:
    file.write_text(text)
    assert problems_of(file, SCHEMAS["prf"]) == [f"{file}:1: laser is a table. Write [laser] once, and its keys below."]


ODD = ("1979-05-27", "07:32:00", "inf", "nan", "-1", "0", "1e300", "123456789012345678901234567890", "true", "''",
       "'safe'", "[]", "[[1]]", "[1, 2, 3]", "[0, 0, 0]", "[1e200, 1, 1]", "{}", "{ a = 1 }", "['x', 1]")  # fmt: skip


@pytest.mark.parametrize("tool", SCHEMAS)
@pytest.mark.parametrize("value", ODD)
def test_whatever_a_value_is_the_answer_is_a_line_each(tool: str, value: str, file: Path) -> None:
    keys = [(table, key) for table, content in SCHEMAS[tool].tables.items() for key in content.keys]
    for table, key in [*keys, ("preset", "x"), ("", "preset"), ("", "nothing"), ("nothing", "x")]:
        file.write_text(f"[{table}]\n{key} = {value}\n" if table else f"{key} = {value}\n")
        for problem in problems_of(file, SCHEMAS[tool]):
            assert problem.startswith(f"{file}:")
            assert "\n" not in problem


def test_a_name_on_the_command_line_is_told_as_such() -> None:
    with pytest.raises(ConfigError, match=r"^--preset: there is no preset 'x'"):
        settings_from(None, ("x",), SCHEMAS["prf"])


def test_a_schema_without_presets_has_none(file: Path) -> None:
    assert preset_names(Schema({}, presets="tests")) == []
