"""A replay in words."""

from benchmarks.replay.scoring import Played
from benchmarks.replay.setting import Setting
from benchmarks.trials.fixes import FOUND
from deqmcl_gym.logs import Log
from localizers.models.nav2_motion import kind_of

NO_ERROR = (
    "There is no reference, so no error is known. The share of beams that agree with the map is no "
    "substitute: a wrong place that looks alike agrees equally well."
)

_UNKNOWN = {
    "obstacle": "obstacles, which stop beams and the robot",
    "transparent": "transparent, they stop the robot but no beam",
    "free": "free, they stop neither beams nor the robot",
}


def overview(setting: Setting) -> str:
    """Say what was played."""
    log = setting.log
    return (
        f"{len(log):,} records of {log.source} with {log.scanner.beams} beams each on the map "
        f"{setting.map}, {log.driven[-1]:,.0f} {log.unit} by odometry."
    )


def facts(setting: Setting) -> list[str]:
    """Say what the localizers assume."""
    motion, log = setting.motion, setting.log
    found = [
        f"Motion model: {kind_of(motion)}, "
        + ", ".join(f"{name} {value:.3g}" for name, value in vars(motion).items())
        + f" ({setting.noise}).",
        f"Scan model: {setting.scan}. Radius of the robot: {setting.radius:g} {log.unit}.",
        f"Unknown cells of the map: {_UNKNOWN[setting.unknown]}.",
        "Start: anywhere on the map."
        if setting.start is None
        else "Start: known to 0.2 m and 0.1 rad, around ({:.2f}, {:.2f}, {:.2f} rad).".format(
            *setting.start
        ),
        "Poses are of the robot's base (ROS: base_link): the start, the reference and tracks/*.tum."
        + _mounted(log),
    ]
    if setting.calibration:
        found.insert(2, setting.calibration)
    return [*found, setting.reference or NO_ERROR]


def _mounted(log: Log) -> str:
    x, y = log.scanner.mounting
    if (x, y) == (0, 0):
        return ""
    return f" The scanner is mounted at ({x:g}, {y:g}) {log.unit} on it, ahead and left."


def told(played: Played) -> str:
    """Say how a run ended: where it was lost, or how far off it was at most."""
    if played.errors is None:
        return f"{played.agreement[1]:.0%} of the beams within 0.3 m of the map."
    within = f"{played.scores[f'within_{FOUND}']:.0%} of its records are within 1 m and 30°"
    if played.lost is None:
        return f"localized to the end; {within}, the largest error is {_largest(played)}."
    record, way = played.lost
    if record == played.known[0]:
        return (
            f"never within 1 m and 30° of the reference; the largest error is {_largest(played)}."
        )
    elapsed = played.track.times[record] - played.track.times[0]
    return (
        f"lost after {way:.1f} m, {elapsed:,.1f} s: never again within 1 m and 30°; {within}, the "
        f"largest error is {_largest(played)}."
    )


def _largest(played: Played) -> str:
    assert played.errors is not None
    return f"{played.errors.translation.max():.2f} m"
