"""Commands and links that stand in README and docs: verbs, options, targets and files are there as written."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import mapq.cli
import prf.cli

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
PAGES = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "data/README.md", "benchmarks/README.md"]
COMMAND = re.compile(r"^(?: {4}|`)((?:prf|mapq) [a-z][^`]*?)`?$")
LINK = re.compile(r"\]\(([^)#]+)(#[^)]*)?\)")


def pages(root: Path) -> list[Path]:
    return [root / name for name in PAGES] + sorted((root / "docs").rglob("*.md"))


def shown_commands(root: Path) -> list[tuple[str, str]]:
    """Return each command shown on a line of its own, with the page and line it stands on."""
    found = []
    for page in pages(root):
        for number, line in enumerate(page.read_text().splitlines(), 1):
            match = COMMAND.match(line)
            if match and not re.search(r"[A-Z]{3,}|\.\.\.|[|<>\[]", match[1].partition("#")[0]):
                where = f"{page.relative_to(root)}:{number}"
                found += [(where, part.strip()) for part in re.split(r"&&|;", match[1].partition(" #")[0])]
    return found


def words_of(command: str) -> list[str]:
    return shlex.split(command)


def test_commands_are_found(project_root: Path) -> None:
    shown = shown_commands(project_root)
    assert len(shown) > 80
    assert {words_of(command)[0] for _, command in shown} == {"prf", "mapq"}


def test_every_verb_is_shown(project_root: Path) -> None:
    shown = {tuple(words_of(command)[:2]) for _, command in shown_commands(project_root)}
    verbs = {(tool, verb) for tool, module in TOOLS.items() for verb in module.VERBS}
    assert verbs - shown == set()


def test_every_command_can_be_parsed(project_root: Path) -> None:
    wrong = {}
    for place, command in shown_commands(project_root):
        tool, *words = words_of(command)
        group = TOOLS[tool].app
        verb = group.get_command(None, words[0])
        if verb is None:
            wrong[place] = f"{tool} has no verb {words[0]}"
            continue
        try:
            verb.make_context(words[0], words[1:]).close()
        except Exception as error:
            wrong[place] = f"{command}: {getattr(error, 'message', error)!r}"
    assert wrong == {}


def test_local_links_lead_to_files(project_root: Path) -> None:
    broken = []
    for page in pages(project_root):
        for target, _ in LINK.findall(page.read_text()):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(project_root)} -> {target}")
    assert broken == []


def test_targets_of_make_are_there(project_root: Path) -> None:
    makefile = (project_root / "Makefile").read_text()
    for page in pages(project_root):
        for target in re.findall(r"`make ([a-z][a-z-]*)`", page.read_text()):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{page.name}: make {target}"


def test_benchmarks_are_there(project_root: Path) -> None:
    for page in pages(project_root):
        for name in re.findall(r"python -m benchmarks\.([a-z_0-9]+)", page.read_text()):
            assert (project_root / "benchmarks" / f"{name}.py").is_file(), f"{page.name}: benchmarks.{name}"
