"""Reference scores of every environment: ``python docs/examples/acting/scores.py --help``.

The rows are those of ``benchmarks.evaluate``; films show the episode of seed 0.
"""

import argparse
import math
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import PIL.Image

from benchmarks.evaluation import REFERENCES, Evaluation, evaluate
from benchmarks.report.films import webp
from deqmcl_gym.files import write_bytes
from deqmcl_gym.validation import InputError

_PICTURES = 40  # of a film, about
_BASELINE = "spin"
_NAMES = {
    "±": "return_2se", "gain ±": "gain_2se", "done low": "done_low", "done high": "done_high",
}  # fmt: skip


class Filmed(gym.Wrapper[Any, Any, Any, Any]):
    """Takes a picture at each step."""

    def __init__(self, env: gym.Env[Any, Any], pictures: list[Any]) -> None:
        super().__init__(env)
        self._pictures = pictures

    def reset(self, **given: Any) -> Any:
        """Begin an episode."""
        result = self.env.reset(**given)
        self._pictures.append(self.env.render())
        return result

    def step(self, action: Any) -> Any:
        """Pass a step on."""
        result = self.env.step(action)
        self._pictures.append(self.env.render())
        return result


def film(task: str, policy: str) -> bytes:
    """Return the episode of seed 0 as an animated WebP of about 40 pictures, at half their size."""
    taken: list[Any] = []
    wrap = partial(Filmed, pictures=taken)
    made = {"wrap": wrap, "render_mode": "rgb_array"}
    evaluate(task, policy, episodes=1, reference=None, **made)  # type: ignore[arg-type]
    every = math.ceil(len(taken) / _PICTURES)
    few = [*taken[:-1:every], taken[-1]]
    small = [np.asarray(PIL.Image.fromarray(picture).reduce(2)) for picture in few]
    return webp(small, 40 * every)


def table(evaluations: Iterable[Evaluation]) -> pd.DataFrame:
    """Return a row each, the best first; ``…_2se`` are two standard errors."""
    rows = pd.DataFrame([own.row for own in evaluations])
    rows = rows.rename(columns=_NAMES)
    return rows.sort_values("return", ascending=False, ignore_index=True)


def main() -> None:
    """Print the tables asked for, as CSV."""
    words = (
        "Scores of reference policies, as CSV. 2se: two standard errors; gain: above spin in the "
        "same episodes; steps: the median, episodes that were not done counted as endless."
    )
    parser = argparse.ArgumentParser("python docs/examples/acting/scores.py", description=words)
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"of {', '.join(REFERENCES)}; all")
    parser.add_argument("--policies", help="some of the task's, separated by commas without space")
    parser.add_argument("--episodes", type=int, default=20, help="seeds 0, 1, …; default 20")
    parser.add_argument("--films", type=Path, metavar="DIR", help="films only: TASK-POLICY.webp, "
        "the episode of seed 0")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=2, help="processes; default 2")
    given = parser.parse_args()
    try:
        _score(given)
    except InputError as error:
        parser.error(str(error))


def _score(given: argparse.Namespace) -> None:
    for task in given.tasks or REFERENCES:
        policies = given.policies.split(",") if given.policies else REFERENCES.get(task, [])
        if given.films is not None:
            for name in policies:
                write_bytes(given.films / f"{task}-{name}.webp", film(task, name))
            continue
        base = evaluate(task, _BASELINE, episodes=given.episodes, reference=None)
        score = partial(evaluate, task, episodes=given.episodes, reference=base)
        with ProcessPoolExecutor(given.jobs) as pool:
            others = pool.map(score, (name for name in policies if name != _BASELINE))
            rows = table([base, *others])
        rows.insert(0, "task", task)
        print(rows.round(3).to_csv(index=False), flush=True)


if __name__ == "__main__":
    main()
