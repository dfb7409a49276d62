"""What each key of a settings file of `mapq` means (docs/configuration.md says the same)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from prf.shell.configuration import Meaning

TABLE_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "segment": "How a cloud is cut into patches (docs/segmentation.md), by segment and classify",
        "features": "How patches are measured (docs/features.md), by features and train; classify does as its model",
        "crf": "The random field (docs/crf.md), by train; max_false_alarms by classify too",
    }
)
KEY_WORDS: Mapping[str, Meaning] = MappingProxyType(
    {
        "segment.neighbours": Meaning("", "nearest neighbours that make a normal"),
        "segment.resolution": Meaning("m", "side of cells, of each of which one point is looked at first; 0: all"),
        "segment.noise": Meaning("m", "standard deviation of points off their surface"),
        "segment.max_angle": Meaning("deg", "between a point's normal and its patch's"),
        "segment.max_distance": Meaning("m", "from a point to its patch's plane"),
        "segment.max_gap": Meaning("m", "patches end at wider gaps"),
        "segment.max_variation": Meaning("", "of normals that count: 0 plane, 1/3 ball"),
        "segment.min_points": Meaning("", "smaller patches are dropped"),
        "segment.min_extent": Meaning("m", "narrower patches are dropped"),
        "segment.max_tilt": Meaning("deg", "planes farther from vertical are dropped; 90 keeps all"),
        "segment.up": Meaning("", "the vertical, of any length"),
        "features.reading": Meaning("", "safe: bounded features in metres; literal: the equations as printed"),
        "features.neighbours": Meaning("", "closest patches that each patch is joined to"),
        "features.watched": Meaning("", "of so many closest patches those are joined too that lie over it or cross it"),
        "features.radius": Meaning("m", "patches farther apart are no neighbours"),
        "features.tau": Meaning("m", "distance over which a pair's weight falls to 1/e"),
        "features.eps": Meaning("m", "what the sensor cannot resolve"),
        "features.noise": Meaning("m", "standard deviation of points from a surface"),
        "features.tolerance": Meaning("m", "distance at which surfaces count half as doubled; at least 3.3 noise"),
        "features.spacing": Meaning("m", "between points"),
        "features.up": Meaning("", "direction of the z axis of equation 7"),
        "features.context": Meaning("", "groups of context features: outlines, moments, rays, copies"),
        "crf.objective": Meaning("", "pl: maximum pseudo-likelihood; max-margin: structured support vector machine"),
        "crf.potential": Meaning("", "trees: boosted trees on patches and pairs; linear: a sum over node features"),
        "crf.edge_model": Meaning("", "symmetric: pairs speak for equal labels; none: not at all"),
        "crf.regularisation": Meaning("", "precision of each weight's prior"),
        "crf.coupling_regularisation": Meaning("", "the same, of the coupling"),
        "crf.class_weight": Meaning("", "balanced: both labels weigh the same in sum; none: every patch does"),
        "crf.folds": Meaning("", "of the cross-validation over regions"),
        "crf.max_false_alarms": Meaning("", "share of the plausible patches that may be called suspicious"),
    }
)
SOURCES: Mapping[str, str] = MappingProxyType(
    {
        "segment": "estimated from the cloud",
        "features": "from the patches",
        "crf": "by cross-validation",
        "crf.max_false_alarms": "as trained",
    }
)
"""Where a value comes from that is not set and has no default: by table, or by key where that differs."""


def source_of(table: str, key: str) -> str:
    """Return in words where the value of a key without default comes from."""
    return SOURCES.get(f"{table}.{key}", SOURCES[table])
