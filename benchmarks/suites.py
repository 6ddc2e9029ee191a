"""The named experiments, as data. A TOML file says the same: see ``benchmarks.sweepfile``."""

import math
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from benchmarks.design import Axis, Method, Sweep
from benchmarks.spec import Params, Trial, frozen

PAPER_METHODS = (
    "mcl",
    "mcl-smoother",
    "mcl-map",
    "mcl-map-smoother",
    "deq-mcl",
    "dead-reckoning",
)
CLASSICAL = ("grid", "amcl", "ekf")
BEYOND = ("deq-mcl-rejuvenated", "mcl-h", "mcl-pilots")
_PRESETS = ("paper", "matched", "sharp")


def paper_sweep(
    *,
    preset: str = "paper",
    localizers: Sequence[str] = PAPER_METHODS,
    trials: int = 10,
    seed: int = 0,
    lag: int = 20,
    **params: Any,
) -> Sweep:
    """Return the paper's experiment: all methods on the same worlds of one preset.

    Args:
        preset: name of the world.
        localizers: names; each gets those of ``params`` (and ``lag``) that it has a use for.
        trials: number of worlds.
        seed: root of all randomness.
        lag: L.
        params: of the localizers.
    """
    return Sweep(
        title="The paper's experiment",
        preset=preset,
        localizers=_methods(localizers),
        trials=trials,
        seed=seed,
        lag=lag,
        params=frozen(params),
    )


def paper_suite(**given: Any) -> list[Trial]:
    """Return the trials of ``paper_sweep``, which takes the same arguments."""
    return paper_sweep(**given).distinct()


def with_localizers(sweep: Sweep, names: Sequence[str]) -> Sweep:
    """Return a sweep with further localizers; one that it has already is not added."""
    known = {method.name for method in sweep.localizers}
    added = [name for name in dict.fromkeys(names) if name not in known]
    return replace(sweep, localizers=(*sweep.localizers, *_methods(added)))


def _methods(names: Sequence[str]) -> tuple[Method, ...]:
    return tuple(Method(name=name) for name in names)


def _axis(**values: Sequence[Any]) -> Axis:
    """An axis whose names are written with __ for a dot."""
    return Axis(values={name.replace("__", "."): tuple(v) for name, v in values.items()})


def _home_again() -> tuple[tuple[float, float], ...]:
    """Actions from step 100 of the paper room's lap: turn round and drive back to the start."""
    drive, left, right = (5.0, 0.0), (0.0, math.pi / 12), (0.0, -math.pi / 12)
    return (
        *(left,) * 12,
        *(drive,) * 23,
        *(right,) * 6,
        *(drive,) * 40,
        *(right,) * 6,
        *(drive,) * 25,
    )


def _wrapper(kind: str, **arguments: Any) -> Params:
    return frozen({"kind": kind} | arguments)


SUITES = MappingProxyType(
    {
        "quick": Sweep(
            title="A quick look: all methods, few worlds",
            localizers=_methods(PAPER_METHODS),
            trials=5,
            params=frozen({"particles": 500}),
        ),
        "paper": paper_sweep(particles=1000),
        "headline": Sweep(
            title="All methods on 200 worlds of each preset, 3 runs each",
            localizers=_methods(PAPER_METHODS),
            trials=200,
            filter_seeds=3,
            params=frozen({"particles": 1000}),
            vary=(_axis(preset=_PRESETS),),
        ),
        "particles": Sweep(
            title="Error against the number of particles",
            localizers=_methods(PAPER_METHODS[:-1]),
            trials=40,
            vary=(
                _axis(preset=_PRESETS),
                _axis(params__particles=(30, 100, 300, 1000, 3000)),
            ),
        ),
        "lag": Sweep(
            title="Error against the lag L of the queue",
            localizers=_methods(("mcl-smoother", "mcl-map-smoother", "deq-mcl")),
            trials=40,
            params=frozen({"particles": 1000}),
            vary=(_axis(preset=_PRESETS), _axis(lag=(0, 5, 10, 20, 40))),
        ),
        "beta": Sweep(
            title="Error against β, the charge on a step that collides",
            localizers=_methods(("mcl", "mcl-map", "mcl-map-smoother", "deq-mcl")),
            trials=40,
            params=frozen({"particles": 1000}),
            vary=(_axis(preset=_PRESETS), _axis(params__beta=(0.0, 1.0, 3.0, 10.0, 30.0))),
        ),
        "sensor": Sweep(
            title="Error against the noise of the sensor, which the filters know",
            localizers=_methods(PAPER_METHODS),
            preset="matched",
            trials=40,
            params=frozen({"particles": 1000}),
            vary=(
                _axis(world__lidar__beams=(1, 9)),
                _axis(
                    world__lidar__sigma=(5.0, 20.0, 50.0, 100.0),
                    assumed__scan__sigma=(5.0, 20.0, 50.0, 100.0),
                ),
            ),
        ),
        "noise": Sweep(
            title="Error against the noise of the motion, which the filters know",
            localizers=_methods(PAPER_METHODS),
            preset="matched",
            trials=40,
            params=frozen({"particles": 1000}),
            vary=(
                _axis(
                    world__noise__drive=(0.02, 0.05, 0.1, 0.2),
                    world__noise__turn=(0.02, 0.05, 0.1, 0.2),
                    world__noise__drift=(0.0005, 0.00125, 0.0025, 0.005),
                    assumed__motion__drive=(0.02, 0.05, 0.1, 0.2),
                    assumed__motion__turn=(0.02, 0.05, 0.1, 0.2),
                    assumed__motion__drift=(0.0005, 0.00125, 0.0025, 0.005),
                ),
            ),
        ),
        "disturbed": Sweep(
            title="Trouble at half of the lap: none, kidnapped, beams lost, plan changed",
            localizers=_methods((*PAPER_METHODS, *BEYOND, *CLASSICAL)),
            preset="sharp",
            trials=40,
            params=frozen({"particles": 1000}),
            vary=(
                _axis(
                    disturbance=(
                        (),
                        (_wrapper("kidnap", step=100),),
                        (_wrapper("dropout", probability=0.5),),
                        (_wrapper("plan-change", step=100, actions=_home_again()),),
                    )
                ),
            ),
        ),
    }
)
