"""The logs of a laser and of a sonar, read together."""

from __future__ import annotations

from prf.logs.open import read_readings
from prf.logs.readings import OwnPoses, Readings
from prf.logs.rings import CONE
from prf.shell.errors import ConfigError


def read_logs(
    laser: str | None,
    sonar: str | None,
    *,
    topic: str | None = None,
    frame: str | None = None,
    sonar_topic: str | None = None,
    cone: float = CONE,
) -> tuple[Readings | None, Readings | None]:
    """Read the log of a laser, of a sonar or of both; None for a sensor without log.

    Parameters
    ----------
    laser, sonar : str or None
        Logs, which may be the same file.
    topic, sonar_topic : str, optional
        Whose readings to take of each, see :func:`prf.logs.read_readings`.
    frame : str, optional
        In what frame, for both; laser lines of CARMEN carry their poses, so there it is for the sonar alone.
    cone : float, optional
        Full opening angle in radians of sonar readings whose log has none.

    Raises
    ------
    ConfigError
        If there is a topic of a sensor that has no log, or as :func:`prf.logs.read_readings`.
    InputError
        Likewise.
    """
    if topic is not None and laser is None:
        raise ConfigError(
            f"--topic {topic}: names readings of --laser, which is not given. For a sonar: --set "
            "readings.sonar_topic=NAME."
        )
    if sonar_topic is not None and sonar is None:
        raise ConfigError(f"readings.sonar_topic {sonar_topic}: names readings of --sonar, which is not given.")
    return (
        _laser(laser, topic, frame, has_sonar=sonar is not None) if laser is not None else None,
        read_readings(sonar, "sonar", topic=sonar_topic, frame=frame, cone=cone) if sonar is not None else None,
    )


def _laser(path: str, topic: str | None, frame: str | None, has_sonar: bool) -> Readings:
    try:
        return read_readings(path, topic=topic, frame=frame)
    except OwnPoses:
        if not has_sonar:
            raise
        return read_readings(path, topic=topic)
