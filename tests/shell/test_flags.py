"""Options of a verb come from the fields of its tables, and reach it as one settings object."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import pytest
import typer
from click.testing import CliRunner

from prf.shell.cli.app import make_command
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded, SettingError, Table, Tree, key
from prf.shell.errors import ArgumentError, ConfigError


class Lens(Table):
    """A lens."""

    radius: float | None = key(None, "m", "of the glass", flag="METRES", unset="that of the frame", gt=0.0)
    turns: int = key(3, "", "how often it is turned", flag="N", ge=1)
    size: tuple[float, float] | None = key(None, "m", "width and height", flag="W H")
    kind: Literal["thin", "thick"] = key("thin", "", "thin or thick", flag="KIND")
    is_coated: bool = key(False, "", "whether it is coated", flag="yes")
    rare: float = key(0.5, "", "a rare number")

    def check(self) -> None:
        """Refuse thick lenses without glass."""
        if self.kind == "thick" and self.radius is None:
            raise SettingError("a thick lens needs a radius", "radius", "kind")


class Frame(Table):
    """A frame."""

    width: float = key(1.0, "m", "of the frame", flag="METRES")


class Toy(Tree):
    """Two tables."""

    PACKAGE: ClassVar[str] = "prf"

    lens: Lens = Lens()
    frame: Frame = Frame()


SEEN: list[tuple[Loaded[Toy], bool]] = []


@with_settings(Toy, "lens", "frame.width", defaults={"lens.turns": 5})
def look(
    *,
    source: Annotated[str | None, typer.Option("--source", help="Of light.")] = None,
    settings: Loaded[Toy],
    json: Json = False,
) -> None:
    """Look through a lens."""
    SEEN.append((settings, json))


def called(*arguments: str) -> Any:
    SEEN.clear()
    return CliRunner().invoke(make_command(look, ["look"]), arguments)


def test_options_have_the_names_units_defaults_and_bounds_of_the_fields() -> None:
    text = " ".join(called("--help").output.split())
    assert "--radius METRES Of the glass. [that of the frame]" in text
    assert "--turns N How often it is turned. [5] [x>=1]" in text
    assert "--size W H" in text
    assert "--is-coated / --no-is-coated" in text
    assert "--width METRES Of the frame. [1]" in text
    assert "--rare" not in text
    assert text.index("--config") < text.index("--radius") < text.index("--json")


def test_the_verb_is_given_one_settings_object() -> None:
    assert called("--size", "1", "2", "--set", "lens.rare=0.25", "--is-coated", "--json").exit_code == 0
    [(found, json)] = SEEN
    assert json
    assert found.settings.lens == Lens(turns=5, size=(1.0, 2.0), rare=0.25, is_coated=True)
    assert found.sources == {"lens.rare": "--set lens.rare", "lens.size": "--size", "lens.is_coated": "--is-coated"}


def test_what_cannot_be_used_is_named_by_its_flag() -> None:
    assert isinstance(error := called("--radius", "-1").exception, ConfigError)
    assert str(error) == "--radius = -1.0: must be above 0, in m."
    assert str(called("--kind", "thick").exception) == "--kind: a thick lens needs a radius."
    assert str(called("--set", "lens.turms=1").exception).startswith("--set lens.turms: unknown key. Did")


def test_one_input_alone_is_standard_input() -> None:
    assert str(called("--config", "-", "--source", "-").exception) == (
        "--source - --config -: standard input can be read once only."
    )


def test_tables_made_in_python_name_the_keyword() -> None:
    with pytest.raises(ValueError, match=r"^radius = -1\.0: must be above 0, in m\.$") as caught:
        Lens(radius=-1.0)
    assert isinstance(caught.value, ArgumentError)
    with pytest.raises(ArgumentError, match=r"^kind: a thick lens needs a radius\.$"):
        Lens(kind="thick")
    with pytest.raises(ArgumentError, match=r"^rim: unknown key\. Known are"):
        Lens(**{"rim": 1})  # type: ignore[arg-type]
    assert Lens(radius=1.0).replace(kind="thick").kind == "thick"
    with pytest.raises(ArgumentError, match="thick lens"):
        Lens().replace(kind="thick")
