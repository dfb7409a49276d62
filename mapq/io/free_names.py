"""Fields under names and in shapes that formats of plain columns have, and under names that nothing else needs."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Container, Iterator, Mapping

from mapq.io.fields import Array

logger = logging.getLogger(__name__)

ORIGINAL = "original_"
"""Before the names of fields that points had and something else needs."""


def original_names(fields: Mapping[str, Array], needed: Collection[str]) -> dict[str, Array]:
    """Return the fields, those with `needed` names under `ORIGINAL` ones: with the prefix as often as it takes."""
    renamed: dict[str, Array] = {}
    for name, values in fields.items():
        free = name
        if name in needed:
            free = ORIGINAL + name
            while free in fields or free in renamed or free in needed:
                free = ORIGINAL + free
        renamed[free] = values
    return renamed


def scalar_columns(name: str, values: Array) -> Iterator[tuple[str, Array]]:
    """Yield the columns (n,) of a field (n, ...) under their names: `name_0` and so on where there are several."""
    if values.ndim == 1:
        yield name, values
        return
    flat = values.reshape(len(values), -1)
    for number in range(flat.shape[1]):
        yield f"{name}_{number}", flat[:, number]


def free_name(name: str, taken: Container[str], longest: int | None = None) -> str:
    """Return a name of printable ASCII without blanks that is not taken, as near to `name` as can be.

    Parameters
    ----------
    name : str
    taken : container of str
    longest : int, optional
        Characters that it may have.
    """
    valid = re.sub(r"[^!-~]", "_", name)[:longest] or "field"
    free, number = valid, 2
    while free in taken:
        end = f"_{number}"
        free = (valid if longest is None else valid[: longest - len(end)]) + end
        number += 1
    if free != name:
        logger.info("field %r is written as %s", name, free)
    return free
