"""Parameters of the sensors from readings at known poses in a known map (docs/calibration.md)."""

from prf.calibrate.drive import Calibrated, calibrate_laser, calibrate_sonar
from prf.calibrate.fit import Fit, fit, held_out_loss
from prf.calibrate.maps import read_known_map
from prf.calibrate.settings import fitted_text

__all__ = [
    "Calibrated",
    "Fit",
    "calibrate_laser",
    "calibrate_sonar",
    "fit",
    "fitted_text",
    "held_out_loss",
    "read_known_map",
]
