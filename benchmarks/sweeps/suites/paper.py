"""The paper's experiment and its methods: on few worlds, on many, over one parameter at a time."""

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from benchmarks.setup.changes import Changes
from benchmarks.sweeps.design import Sweep
from benchmarks.sweeps.suites.parts import AMCL_ON_ROBOT, axis, home_again, methods, noises, wrapper
from benchmarks.trials.spec import Trial

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
SCENARIOS = ("paper", "matched", "sharp")
_SIGMAS = (5.0, 20.0, 50.0, 100.0)
_NOISES = (0.02, 0.05, 0.1, 0.2)


def paper_sweep(
    *,
    scenario: str = "paper",
    localizers: Sequence[str] = PAPER_METHODS,
    trials: int = 10,
    seed: int = 0,
    lag: int = 20,
    **params: Any,
) -> Sweep:
    """Return the paper's experiment: all methods on the same worlds of one scenario.

    Args:
        scenario: name of the world.
        localizers: names; each gets those of ``params`` (and ``lag``) that it has a use for.
        trials: number of worlds.
        seed: root of all randomness.
        lag: L.
        params: of the localizers.
    """
    return Sweep(
        title="The paper's experiment",
        scenario=scenario,
        localizers=methods(*localizers),
        trials=trials,
        seed=seed,
        lag=lag,
        params=Changes(params),
    )


def paper_suite(**given: Any) -> list[Trial]:
    """Return the trials of ``paper_sweep``, which takes the same arguments."""
    return paper_sweep(**given).distinct()


_VARIED = replace(paper_sweep(particles=1000), trials=40)

PAPER_SUITES = MappingProxyType(
    {
        "quick": Sweep(
            title="A quick look: the paper's methods on few worlds",
            localizers=methods(*PAPER_METHODS),
            trials=10,
            params=Changes({"particles": 500}),
        ),
        "paper": paper_sweep(particles=1000),
        "headline": replace(
            _VARIED,
            title="The paper's methods on 200 worlds of three scenarios, 3 runs each",
            trials=200,
            filter_seeds=3,
            vary=(axis(scenario=SCENARIOS),),
        ),
        "particles": replace(
            _VARIED,
            title="Error against the number of particles",
            localizers=methods(*PAPER_METHODS[:-1]),
            params=Changes(),
            vary=(
                axis(scenario=SCENARIOS),
                axis(params__particles=(30, 100, 300, 1000, 3000)),
            ),
        ),
        "lag": replace(
            _VARIED,
            title="Error against the lag L of the queue",
            localizers=methods("mcl-smoother", "mcl-map-smoother", "deq-mcl"),
            vary=(axis(scenario=SCENARIOS), axis(lag=(0, 5, 10, 20, 40))),
        ),
        "beta": replace(
            _VARIED,
            title="Error against β, the charge on a step that collides",
            localizers=methods("mcl", "mcl-map", "mcl-map-smoother", "deq-mcl"),
            vary=(axis(scenario=SCENARIOS), axis(params__beta=(0.0, 1.0, 3.0, 10.0, 30.0))),
        ),
        "sensor": replace(
            _VARIED,
            title="Error against the noise of the sensor, which the filters know",
            scenario="matched",
            vary=(
                axis(world__lidar__beams=(1, 9)),
                axis(world__lidar__sigma=_SIGMAS, assumed__scan__sigma=_SIGMAS),
            ),
        ),
        "noise": replace(
            _VARIED,
            title="Error against the noise of the motion, which the filters know",
            scenario="matched",
            vary=(
                axis(
                    **noises("world__noise", _NOISES, 40), **noises("assumed__motion", _NOISES, 40)
                ),
            ),
        ),
        "disturbed": replace(
            _VARIED,
            title="Disturbances halfway round: none, kidnapping, lost beams, a new plan",
            localizers=(*methods(*PAPER_METHODS, *BEYOND, *CLASSICAL), AMCL_ON_ROBOT),
            scenario="sharp",
            vary=(
                axis(
                    disturbance=(
                        (),
                        (wrapper("kidnap", step=100),),
                        (wrapper("dropout", probability=0.5),),
                        (wrapper("plan-change", step=100, actions=home_again()),),
                    )
                ),
            ),
        ),
    }
)
