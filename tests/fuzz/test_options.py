"""Every option of every verb with values beyond reason: refused in one line, or taken; never an internal error."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from tests.fuzz.calls import call
from tests.fuzz.reader import little_room
from tests.fuzz.test_outputs import clear
from tests.fuzz.verbs import VERBS, make_samples

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
VALUES = ("1e308", "-1e308", "1e-300", "nan", "inf", "0", "-1", "0.5", "9" * 20, "9" * 400)
ENDLESS = ("--steps", "--time-budget")
"""Of `prf sample` and `prf anneal`: such values are taken, and the run goes on until it is stopped."""
ONE_OF_EACH = {" ".join(verb.call.split()[:2]): verb for verb in VERBS}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("options") / "work"
    place.mkdir()
    make_samples(place)
    (place.parent / "beside").write_text("")
    return place


def options(name: str) -> Iterator[tuple[str, int]]:
    """Give the options of a verb that take values, but for the output, and how many."""
    tool, verb = name.split()
    for param in TOOLS[tool].app.get_command(None, verb).params:
        if param.param_type_name == "option" and not param.is_flag and "--output" not in param.opts:
            option = next(each for each in param.opts if each.startswith("--"))
            if option not in ENDLESS:
                yield option, param.nargs


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE_OF_EACH)
def test_no_value_of_an_option_breaks_a_verb(name: str, folder: Path) -> None:
    whole = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for option, n_values in options(name):
        for value in VALUES:
            with little_room():
                said = call(" ".join([ONE_OF_EACH[name].call, option, *[value] * n_values]), folder)
            assert said.code in (0, 1, 2, 3, 4), said
            if said.code > 1:
                assert said.err.startswith("error: "), said
                assert said.err.count("\n") == 1, said
            clear(folder)
            for path, content in whole.items():
                path.write_bytes(content)
