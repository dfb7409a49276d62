"""A model for maps in tiles."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.configuration import SIZES, SimulateSettings, TrainSettings
from mapq.model import Model
from mapq.patches import label_from_field
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.training import train_maps


@pytest.fixture(scope="session")
def model() -> Model:
    """A linear model of a drive that drifts."""
    drive = simulate(SimulateSettings(**SIZES["small"]), 11)
    cloud = drive.with_fields(scan=(drive.fields["time"] // 5.0).astype(np.int32))
    patches, _ = label_from_field(segment(cloud), "truth", "drive")
    settings = TrainSettings(potential="linear", regularisation=1.0, coupling_regularisation=1.0)
    return train_maps([patches], settings)
