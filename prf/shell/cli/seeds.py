"""Seeds: one integer that a user can repeat, and independent generators grown from it."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING

from prf.shell.errors import UsageError

if TYPE_CHECKING:
    import numpy as np


def resolve_seed(seed: int | None) -> int:
    """Return `seed`, or draw one from the system's entropy; the caller prints and stores it.

    Drawn seeds have 32 bits: short enough to be read aloud, exact in JSON. UsageError if `seed` is negative.
    """
    if seed is None:
        return secrets.randbits(32)
    if seed < 0:
        raise UsageError(f"--seed {seed} is negative. Give an integer >= 0.")
    return seed


def spawn_generators(seed: int, n_generators: int) -> list[np.random.Generator]:
    """Return `n_generators` independent generators; the i-th depends on `seed` and i alone.

    Children of one ``SeedSequence``: a fifth chain leaves the first four as they were.
    """
    import numpy as np

    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(n_generators)]
