"""Trees of a model as JSON: a line of text for each node."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from mapq.kernels.trees import LEAF, Trees
from mapq.model import Potential
from prf.shell.storage import damaged

LARGEST = 1e30
"""Of all numbers of a model: products and sums of what lies below are finite."""
SIDES = ("left", "right")
"""Where a node sends what is not known."""


def potential_content(potential: Potential) -> dict[str, Any]:
    """Return trees as the JSON object of a model file.

    A node is ``column threshold left right side mean``, a leaf ``leaf value``: values up to the threshold go to the
    node of the tree numbered `left`, and unknown ones to the side named. Numbers are written in full.
    """
    trees = potential.trees
    ends = [*trees.root.tolist()[1:], len(trees.column)]
    rows = [_node(potential, node) for node in range(len(trees.column))]
    shifted = [
        [
            row.format(left=trees.left[begin + at] - begin, right=trees.right[begin + at] - begin)
            for at, row in enumerate(rows[begin:end])
        ]
        for begin, end in zip(trees.root.tolist(), ends, strict=True)
    ]
    return {"base": potential.base, "columns": list(potential.names), "trees": shifted}


def _node(potential: Potential, node: int) -> str:
    trees = potential.trees
    value = float(trees.value[node])
    if trees.column[node] == LEAF:
        return f"leaf {value!r}"
    name, side = potential.names[int(trees.column[node])], SIDES[0 if trees.nan_left[node] else 1]
    return f"{name} {float(trees.threshold[node])!r} {{left}} {{right}} {side} {value!r}"


def parse_potential(path: Path, content: Mapping[str, Any]) -> Potential:
    """Return the trees of a model file.

    Raises
    ------
    InputError
        If a node is none, asks for a column that there is not, or leads to none behind it.
    """
    base, names, trees = (cast("Any", content.get(name)) for name in ("base", "columns", "trees"))
    are_names = isinstance(names, list) and all(isinstance(name, str) for name in names)
    is_sound = are_names and isinstance(trees, list) and type(base) in (int, float) and abs(base) < LARGEST
    if not is_sound:
        raise damaged(path, "potential has no finite base, or no lists of columns and trees")
    roots: list[int] = []
    rows: list[tuple[float, ...]] = []
    for number, tree in enumerate(trees):
        if not isinstance(tree, list) or not tree:
            raise damaged(path, f"potential.trees.{number} is no list of nodes")
        begin = len(rows)
        roots.append(begin)
        for at, text in enumerate(tree):
            row = _parse_node(text, names, at, len(tree), begin)
            if row is None:
                raise damaged(path, f"potential.trees.{number}.{at} is no node: {str(text)[:60]!r}")
            rows.append(row)
    table = np.array(rows, np.float64).reshape(-1, 6).T
    column, left, right = (table[place].astype(np.int64) for place in (0, 2, 3))
    found = Trees(np.array(roots, np.int64), column, table[1].copy(), left, right, table[4] > 0.0, table[5].copy())
    return Potential(tuple(names), found, float(base))


def _parse_node(text: Any, names: list[str], at: int, n_nodes: int, begin: int) -> tuple[float, ...] | None:
    """Return column, threshold, left, right, whether unknown values go left, and value; None if it is no node."""
    words = text.split() if isinstance(text, str) else []
    try:
        if len(words) == 2 and words[0] == "leaf" and abs(float(words[1])) < LARGEST:
            return LEAF, 0.0, 0, 0, 0.0, float(words[1])
        name, threshold, left, right, side, value = words
        following = int(left), int(right)
        is_sound = abs(float(value)) < LARGEST and not math.isnan(float(threshold)) and side in SIDES
        # Nodes lead on to later ones only, so that every walk ends.
        if is_sound and name in names and all(at < place < n_nodes for place in following):
            ends = (begin + place for place in following)
            return names.index(name), float(threshold), *ends, float(side == SIDES[0]), float(value)
    except ValueError:
        pass
    return None
