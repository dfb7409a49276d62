"""What the features depend on, apart from the patches."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, fields
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from mapq.model import Model
from prf.shell.errors import ConfigError, InputError

Reading = Literal["safe", "literal"]
"""How equations 6 to 13 are read: bounded and in metres, or as printed."""

CONTEXTS = ("outlines", "moments", "rays", "copies")
"""Groups of context features, beyond the paper; moments and rays need fields of times or sensors."""

TOLERANCE_IN_NOISE = 3.3
"""Standard deviations: surfaces closer than this cannot be distinguished from one rough surface."""

MOST_NEIGHBOURS = 10_000
LONGEST = 1e6
"""Metres: no map needs a longer length, and the square of one must be a number."""


@dataclass(frozen=True)
class FeatureSettings:
    """Parameters of the neighbourhood and of the features.

    Attributes
    ----------
    reading : {"safe", "literal"}
    n_neighbours : int
        Closest patches that each patch is joined to; the paper has four.
    radius : float
        Metres (s of the paper, which gives no value): patches farther apart are not neighbours.
    tau : float
        Metres (tau of equation 10, no value either): weights fall to 1/e over it.
    eps : float
        Metres: what a sensor cannot resolve; keeps logarithms finite where patches are exact planes.
    noise : float or None
        Metres: standard deviation of points from their surface. None: the median over the patches. Never below `eps`.
    n_watched : int
        The safe reading watches this many of the closest, and joins them too where they lie over the patch or cross it:
        among windows and doors the second copy of a wall is seldom one of the four closest. 0 for the paper's four.
    tolerance : float
        Metres: two surfaces this far apart count half as doubled; at three quarters of it a tenth, at four thirds nine
        tenths. What crosses must reach this far beyond the other plane. Never below 3.3 deviations of the noise.
    spacing : float or None
        Metres between points. None: for each pair that of its sparser patch.
    up : (3,) tuple or None
        Direction of the z axis of equation 7. None: as the segmentation had it, else z.
    context : tuple of str
        Groups of `CONTEXTS` that are measured, in the safe reading; the literal one has none.
    """

    reading: Reading = "safe"
    n_neighbours: int = 4
    radius: float = 3.0
    tau: float = 2.0
    eps: float = 0.01
    noise: float | None = None
    n_watched: int = 16
    tolerance: float = 0.05
    spacing: float | None = None
    up: tuple[float, float, float] | None = None
    context: tuple[str, ...] = CONTEXTS

    def __post_init__(self) -> None:
        """Refuse values that no map could be measured with.

        Raises ConfigError.
        """
        if self.reading not in ("safe", "literal"):
            raise ConfigError(f"features: reading '{self.reading}' is unknown. Give safe or literal.")
        for name in self.context:
            if name not in CONTEXTS:
                raise ConfigError(f"features: context {name}: must be one of {', '.join(CONTEXTS)}.")
        if not 1 <= self.n_neighbours <= MOST_NEIGHBOURS:
            raise ConfigError(f"features: {self.n_neighbours} neighbours. Give 1 to {MOST_NEIGHBOURS}.")
        if not 0 <= self.n_watched <= MOST_NEIGHBOURS:
            raise ConfigError(f"features: {self.n_watched} patches watched. Give 0 to {MOST_NEIGHBOURS}.")
        for name in ("radius", "tau", "eps", "noise", "tolerance", "spacing"):
            value = getattr(self, name)
            if value is not None and not 0 < value < LONGEST:
                raise ConfigError(f"features: {name} {value} m. Give a length above 0 and below {LONGEST:g}.")
        if self.up is not None and not 0 < math.hypot(*self.up) < math.inf:
            raise ConfigError(f"features: up {self.up}: must be three numbers, not all 0.")

    def tolerance_at(self, noise: float) -> float:
        """Return the distance in metres from which surfaces count as doubled: that given, more where noise is."""
        return max(self.tolerance, TOLERANCE_IN_NOISE * noise)

    def described(self, noise: float, up: list[float]) -> dict[str, object]:
        """Return what features were computed with: the settings, and in their places what was estimated.

        `noise`: standard deviation of points from their surface, in metres. `up`: unit vector.
        """
        return {
            "reading": self.reading,
            "n_neighbours": self.n_neighbours,
            "n_watched": self.n_watched,
            "radius": self.radius,
            "tau": self.tau,
            "eps": self.eps,
            "noise": noise,
            "tolerance": self.tolerance_at(noise),
            "spacing": self.spacing,
            "up": up,
            "context": list(self.context) if self.reading == "safe" else [],
        }


def feature_settings(model: Model) -> FeatureSettings:
    """Return the settings with which the model's features were measured.

    Raises InputError if one is missing, unknown, or outside its domain.
    """
    known = {field.name for field in fields(FeatureSettings)}
    for name in sorted(known ^ set(model.features)):
        state = "is missing" if name in known else "is not known to this release"
        raise InputError(f"the model's feature setting {name} {state}. Train the model anew.")
    try:
        # As JSON: arrays may become tuples there, and no word becomes a number.
        return TypeAdapter(FeatureSettings).validate_json(json.dumps(dict(model.features)), strict=True)
    except (ValidationError, ConfigError) as error:
        what = error.errors()[0] if isinstance(error, ValidationError) else {"loc": (), "msg": str(error)}
        where = "".join(f" {place}" for place in what["loc"][:1])
        raise InputError(
            f"the model's feature setting{where} cannot be used ({what['msg']}). Train the model anew."
        ) from None
