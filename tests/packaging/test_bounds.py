"""One list of oldest and one of newest versions, and both of them say what pyproject.toml says."""

from __future__ import annotations

from tests.packaging.bounds import MINIMUM, NEWEST, declared, pinned


def numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.removesuffix(".*").split("."))


def test_the_oldest_versions_tested_are_the_lower_bounds() -> None:
    assert pinned(MINIMUM) == declared()


def test_the_newest_versions_are_pinned_and_allowed() -> None:
    newest, lowest = pinned(NEWEST), declared()
    assert set(newest) == set(lowest)
    for name, version in newest.items():
        parts = numbers(version)
        assert parts >= numbers(lowest[name])[: len(parts)], name
