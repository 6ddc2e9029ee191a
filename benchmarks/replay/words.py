"""A replay in words."""

from benchmarks.replay.setting import Setting

NO_ERROR = (
    "There is no reference, so no error is known. The share of beams that agree with the map is no "
    "substitute: a wrong place that looks alike agrees equally well."
)


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
        f"Noise of the motion: drive {motion.drive:.3g}, turn {motion.turn:.3g}, drift "
        f"{motion.drift:.3g} rad/{log.unit} ({setting.noise}).",
        f"Scan model: {setting.scan}.",
        "Start: anywhere on the map."
        if setting.start is None
        else "Start: known to 0.2 m and 0.1 rad, around ({:.2f}, {:.2f}, {:.2f} rad).".format(
            *setting.start
        ),
    ]
    return [*found, setting.reference or NO_ERROR]
