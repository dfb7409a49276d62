"""What a user should know before trusting a segmentation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mapq.segmentation.parameters import Parameters

MANY_NARROW = 0.05
FEW_FLAT = 0.3


def warnings_of(chosen: Parameters, n_far: int, found: Mapping[str, Any]) -> list[str]:
    """Return one sentence for each thing that makes the patches of a cloud few or doubtful."""
    said = []
    if found["patches"] == 0:
        said.append(_why_none(found))
    if chosen.narrow_share > MANY_NARROW:
        said.append(
            f"{chosen.narrow_share:.0%} of the points have neighbours along one scan line only, or within the noise, "
            "and show no plane. A coarser --resolution, or more --neighbours, may."
        )
    if chosen.flat_share < FEW_FLAT:
        said.append(
            f"only {chosen.flat_share:.0%} of the neighbourhoods show a plane: spacing and noise are estimated from "
            "little. Give --noise and --resolution if you know better."
        )
    if n_far:
        said.append(f"{n_far} points lie absurdly far from all others and were left out.")
    return said


def _why_none(found: Mapping[str, Any]) -> str:
    """Return why there are no patches: all dropped for one reason, or none found."""
    tilted, small = found["dropped_for_tilt"]["patches"], found["dropped_as_small"]["patches"]
    if tilted:
        return f"no patches: all {tilted} found are tilted too far from vertical. --max-tilt 90 keeps them."
    if small:
        return f"no patches: all {small} regions found are too small. Lower --min-points or --min-extent."
    return "no patches: nothing in this cloud is a plane at its spacing and noise."
