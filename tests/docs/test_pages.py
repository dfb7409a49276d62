"""README and the pages in docs: commands run, links lead somewhere, tables are complete."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from mapq.simulate import Kind
from tests.conftest import ROOT
from tests.docs.blocks import commands_of, differences
from tests.docs.runner import Runner

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "data/README.md", "benchmarks/README.md")] + DOCS
WITH_COMMANDS = {
    str(page.relative_to(ROOT)): page
    for page in [ROOT / "README.md", *DOCS]
    if "docs/reference" not in str(page) and commands_of(page, page.name)
}
QUICK = ("docs/labelling.md", "docs/segmentation.md")
"""Pages whose commands `make test` runs; the others take longer."""
COMMAND = re.compile(r"^(?: {4}|`)((?:prf|mapq) [a-z][^`]*?)`?$")
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)]+))?\)")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a copy of data/, as a fresh clone has."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    return tmp_path


@pytest.fixture
def scheduler(request: pytest.FixtureRequest) -> Callable[[], str]:
    """Return a function that starts a Dask scheduler with a worker on this machine and returns its address."""

    def start() -> str:
        dask = pytest.importorskip("distributed")
        cluster = dask.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        )
        request.addfinalizer(cluster.close)
        return str(cluster.scheduler_address)

    return start


@pytest.mark.parametrize(
    ("name", "start"),
    [(name, "") if name in QUICK else pytest.param(name, "", marks=pytest.mark.slow) for name in WITH_COMMANDS]
    + [("README.md", "mapq ")],
)
def test_commands_of_a_page_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys, scheduler: Callable[[], str], name: str, start: str
) -> None:
    """Run the commands of a page that begin so; of README those of mapq also by themselves, which is quick."""
    monkeypatch.chdir(folder)
    is_tutorial = "tutorials" in name
    runner = Runner(folder, capsys, scheduler, is_tutorial, is_tutorial or name == "README.md")
    commands = [each for each in commands_of(WITH_COMMANDS[name], name) if each.text.startswith(start)]
    for command, follower in zip(commands, [*commands[1:], None], strict=True):
        runner.run(command, follower)


@pytest.mark.parametrize(
    ("shown", "printed", "agree"),
    [
        ("p_free  0.91", "p_free 0.93\n", True),
        ("p_free  0.91", "p_free 0.41\n", False),
        ("8,000 beams... done", "8,100 beams, a note\n and done", True),
        ("8,000 beams", "8,000 cones", False),
        ("8,000 beams", "12,000 beams", False),
    ],
)
def test_what_is_shown_is_compared(shown: str, printed: str, agree: bool) -> None:
    assert (differences(shown, printed, 0.1) is None) == agree


def shown_commands() -> list[tuple[str, list[str]]]:
    """Return the words of each command shown on a line of its own, with its place."""
    found = []
    for page in PAGES:
        for number, line in enumerate(page.read_text().splitlines(), 1):
            match = COMMAND.match(line)
            if match and not re.search(r"[A-Z]{3,}|\.\.\.|[|<>\[]", match[1].partition("#")[0]):
                place = f"{page.relative_to(ROOT)}:{number}"
                found += [(place, shlex.split(part)) for part in re.split(r"&&|;", match[1].partition(" #")[0])]
    return found


def test_every_verb_is_shown_and_every_command_can_be_parsed() -> None:
    wrong, shown = {}, set()
    for place, (tool, verb, *words) in shown_commands():
        shown.add((tool, verb))
        command = TOOLS[tool].app.get_command(None, verb)
        try:
            command.make_context(verb, words).close()
        except Exception as error:
            wrong[place] = f"{tool} {verb} {' '.join(words)}: {getattr(error, 'message', error)!r}"
    assert wrong == {}
    assert {(tool, verb) for tool, module in TOOLS.items() for verb in module.VERBS} <= shown


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of the headings as code hosts name them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", words).strip().replace(" ", "-") for words in plain}


def test_links_lead_to_files_and_headings() -> None:
    broken = []
    for page in PAGES:
        for target, anchor in LINK.findall(page.read_text()):
            if "://" not in target:
                path = page.parent / target if target else page
                if not path.exists() or (anchor and anchor not in anchors_of(path)):
                    broken.append(f"{page.relative_to(ROOT)} -> {target}#{anchor}")
    assert broken == []


def test_every_page_is_in_the_index_and_every_picture_on_a_page() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    names = {page.relative_to(ROOT / "docs").as_posix() for page in DOCS} - {"README.md"}
    assert {name for name in names if f"]({name}" not in index} == set()
    text = "".join(page.read_text() for page in PAGES)
    pictures = list((ROOT / "docs" / "images").iterdir())
    assert [picture.name for picture in pictures if f"images/{picture.name})" not in text] == []
    assert max(picture.stat().st_size for picture in pictures) <= 200_000


def test_targets_of_make_and_benchmarks_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for page in PAGES:
        text = page.read_text()
        for target in re.findall(r"`make ([a-z][a-z-]*)`", text):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{page.name}: make {target}"
        for name in re.findall(r"python -m benchmarks\.([a-z_0-9]+)", text):
            assert (ROOT / "benchmarks" / f"{name}.py").is_file(), f"{page.name}: benchmarks.{name}"


@pytest.mark.parametrize("tool", TOOLS)
def test_every_schema_has_an_entry(tool: str) -> None:
    schema = rf"{tool}\.[a-z_.]+/\d+"
    sources = (ROOT / tool).rglob("*.py")
    written = {name for file in sources for name in re.findall(rf'"({schema})"', file.read_text())}
    text = (ROOT / "docs" / "file-formats.md").read_text()
    entries = set(re.findall(rf"^\|[^|]*\| `({schema})` \|", text, flags=re.MULTILINE))
    assert len(written) > 10
    assert written == entries, "rows | ... | `schema` | in the tables of docs/file-formats.md"


def test_every_kind_of_a_simulated_point_is_in_its_table() -> None:
    text = (ROOT / "docs" / "simulation.md").read_text()
    assert {int(code) for code in re.findall(r"\| (\d+) \| [a-z]", text)} == set(Kind)
