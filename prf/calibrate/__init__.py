"""Parameters of the sensors from readings at known poses in a known map (docs/calibration.md)."""

from prf.calibrate.drive import CalibrateConfig, Calibrated, calibrate_laser, calibrate_sonar
from prf.calibrate.fit import Fit, fit, held_out_loss
from prf.calibrate.maps import read_known_map
from prf.calibrate.settings import fitted_tables

__all__ = [
    "CalibrateConfig",
    "Calibrated",
    "Fit",
    "calibrate_laser",
    "calibrate_sonar",
    "fit",
    "fitted_tables",
    "held_out_loss",
    "read_known_map",
]
