"""Under -q a verb that writes a file says nothing, and one whose result is text prints that text."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from tests.fuzz.calls import call
from tests.fuzz.test_outputs import clear
from tests.fuzz.verbs import VERBS, make_samples

CALLS = [*(verb.call for verb in VERBS), "mapq config show"]
OF_VERB = {" ".join(words.split()[:2]): words for words in reversed(CALLS)}
"""Tool and verb to one call."""
WRITING = {" ".join(verb.call.split()[:2]) for verb in VERBS if verb.writes} | {"mapq label"}
JSON = ("prf grid", "prf simulate", "mapq segment", "mapq label")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("quiet")
    make_samples(path)
    return path


def test_every_verb_is_here() -> None:
    tools = {"prf": prf.cli, "mapq": mapq.cli}
    assert set(OF_VERB) == {f"{tool} {verb}" for tool, module in tools.items() for verb in module.VERBS}


@pytest.mark.parametrize("verb", OF_VERB)
def test_quiet_verbs(verb: str, folder: Path) -> None:
    clear(folder)
    said = call(OF_VERB[verb], folder)  # which is quiet
    assert (said.code, said.err) == (0, "")
    assert (said.out == "") == (verb in WRITING), said.out


@pytest.mark.parametrize("verb", JSON)
def test_json_was_asked_for(verb: str, folder: Path) -> None:
    said = call(OF_VERB[verb], folder, "--json", "--force")
    assert (said.code, said.err) == (0, "")
    assert json.loads(said.out)["schema"]
