"""Reference scores of every environment: ``python docs/examples/acting/scores.py --help``.

Policies see what the env shows, and the belief where there is one; only ``route`` sees the true
pose. In ``Localize-v0`` all declare when ``confident`` is 1, in ``Track-v0`` when 90 % of the
belief is within the tolerance of the goal.
"""

import argparse
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import PIL.Image

import deqmcl_gym  # noqa: F401 # registers the environments
from benchmarks.agents import AGENTS
from benchmarks.pictures.film import webp
from benchmarks.setup import Agent
from benchmarks.tables.stats import wilson
from deqmcl_gym.envs.acting import ActingEnv, TrackEnv
from deqmcl_gym.files import write_bytes
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Singles
from localizers.tasks import BEAM_POWER, OFFICE, robot_model

_BUILDINGS = 20  # of Localize-v0: episode k takes place in that of seed k modulo this
_PICTURES = 40  # of a film, about
_SURE = 0.9
_VAGUE = 0.1  # of the tolerance: standard deviation from which on a scan is taken
_BASELINE = "spin"
_PLAIN = ("still", "spin", "random")
_SENSING = {
    **dict.fromkeys(_PLAIN, "never"),
    "to-goal": "always",
    "to-goal-blind": "never",
    "to-goal-if-vague": "if vague",
    "free-energy": "if vague",
}
SCORED: dict[str, tuple[str, ...]] = {
    **{f"{name}-v0": (*_PLAIN, "plan") for name in ("Room", "Matched", "Sharp", "Guided")},
    "Journey-v1": (*_PLAIN, "plan"),
    "Localize-v0": (*_PLAIN, "wall-follower", "route", "greedy", "four-deep", "free-energy"),
    "Track-v0": tuple(_SENSING),
}
_DRIVER = {"plan": "open-loop", "to-goal-blind": "to-goal", "to-goal-if-vague": "to-goal"}


@dataclass(frozen=True)
class Played:
    """An episode of a policy.

    Attributes:
        score: the return.
        success: whether the task was done.
        wrong: whether a declaration was wrong.
        steps: of the episode.
        metres: driven.
        contacts: with walls.
        scans: taken.
    """

    score: float
    success: bool
    wrong: bool
    steps: int
    metres: float
    contacts: int
    scans: int


def play(task: str, policy: str, seed: int, film: list[Any] | None = None, **made: Any) -> Played:
    """Play an episode, and return its scores.

    Args:
        task: an id without ``deqmcl_gym/``.
        policy: a name among ``SCORED`` of the task.
        seed: of the episode, and of the building in ``Localize-v0``.
        film: takes a picture before each step and one at the end; None: nothing is drawn.
        made: further arguments of ``gym.make``.
    """
    if film is not None:
        made = {"render_mode": "rgb_array"} | made
    if task == "Localize-v0":
        made = {"floor_plan": office_of(seed)} | made
    env = gym.make(f"deqmcl_gym/{task}", **made)
    room: Any = env.unwrapped
    seen, info = env.reset(seed=seed)
    power = BEAM_POWER if task == "Localize-v0" else 1.0
    agent = AGENTS[_DRIVER.get(policy, policy)](robot_model(room.world, power))
    score, steps, metres, contacts, scans = 0.0, 0, 0.0, 0, 0
    agent.plan_at_reset(_shown(room, seen, info))
    terminated = truncated = False
    while not (terminated or truncated):
        before = info["truth"]
        if film is not None:
            film.append(env.render())
        action = _acted(room, agent, _SENSING.get(policy, "never"), seen, info)
        seen, reward, terminated, truncated, info = env.step(action)
        score += float(reward)
        steps += 1
        metres += math.dist(before[:2], info["truth"][:2])
        contacts += int(info["collided"])
        scans += int(seen["sensed"][0]) if isinstance(room, TrackEnv) else 1
    if film is not None:
        film.append(env.render())
    success = bool(info["is_success"])
    return Played(
        score,
        success,
        terminated and not (success or bool(info["collided"])),
        steps,
        metres / metre(room.floor_plan.unit),
        contacts,
        scans,
    )


def office_of(episode: int) -> dict[str, Any]:
    """Return the floor plan in which an episode of ``Localize-v0`` takes place."""
    return {"office": {**OFFICE, "seed": episode % _BUILDINGS}}


def film(task: str, policy: str) -> bytes:
    """Return the episode of seed 0 as an animated WebP of about 80 pictures, at half their size."""
    taken: list[Any] = []
    play(task, policy, 0, taken)
    every = math.ceil(len(taken) / _PICTURES)
    few = [*taken[:-1:every], taken[-1]]
    small = [np.asarray(PIL.Image.fromarray(picture).reduce(2)) for picture in few]
    return webp(small, 40 * every)


def _shown(room: Any, seen: Any, info: dict[str, Any]) -> dict[str, Any]:
    """Return what an agent is told, as the harness tells it."""
    goal = {"goal": np.array(room.goal)} if isinstance(room, TrackEnv) else {}
    return {**info, **goal, "ranges": seen["scan"] if isinstance(seen, dict) else seen}


def _acted(room: Any, agent: Agent, sensing: str, seen: Any, info: dict[str, Any]) -> Singles:
    """Return an agent's action with the heads of the env."""
    if not isinstance(room, ActingEnv):
        return np.asarray(agent.act(None, _shown(room, seen, info))[0], np.float32)  # type: ignore[arg-type] # asks none
    if isinstance(room, TrackEnv):
        poses, weights = room.belief.points()
        off: Floats = np.hypot(*(np.asarray(poses)[:, :2] - room.goal).T)
        declare = float(weights[off <= room.tolerance].sum()) > _SURE
        spread = math.sqrt(float(np.trace(seen["covariance"][:2, :2])))
        sense = sensing == "always" or (sensing == "if vague" and spread > _VAGUE * room.tolerance)
        heads = [float(sense), float(declare)]
    else:
        heads = [float(seen["confident"][0] >= 1.0)]
    move = np.zeros(2) if heads[-1] else agent.act(room.belief, _shown(room, seen, info))[0]
    return np.array([*move, *heads], np.float32)


def summary(played: dict[str, list[Played]]) -> Iterator[dict[str, Any]]:
    """Yield the scores of a policy each, best first.

    ``above`` is the return above the baseline's in the same episodes; ``…_2se`` are two standard
    errors; ``steps`` is the median over all episodes, inf of those not done.
    """
    rows = {
        policy: np.array([list(vars(each).values()) for each in episodes], float)
        for policy, episodes in played.items()
    }
    for policy, row in sorted(rows.items(), key=lambda item: -item[1][:, 0].mean()):
        _, done, wrong, _, *mean = row.mean(axis=0)
        low, high = wilson(done, len(row))
        steps = np.median(np.where(row[:, 1] > 0, row[:, 3], np.inf))
        above: dict[str, Any] = {"above": None, "above_2se": None}
        if policy != _BASELINE and _BASELINE in rows:
            above = _mean("above", row[:, 0] - rows[_BASELINE][:, 0])
        yield {
            "policy": policy, "episodes": len(row), **_mean("return", row[:, 0]), **above,
            "done": done, "done_low": low, "done_high": high, "wrong": wrong,
            "steps": steps if math.isfinite(steps) else None,
            "metres": mean[0], "contacts": mean[1], "scans": mean[2],
        }  # fmt: skip


def table(played: dict[str, list[Played]]) -> Iterator[str]:
    """Yield the lines of a table, a policy each, best first; ± is two standard errors."""
    columns = f"above `{_BASELINE}` | done | wrong | steps | metres | contacts | scans"
    yield f"| policy | return | {columns} |"
    yield "|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    for row in summary(played):
        above = "–" if row["above"] is None else "{above:.1f} ± {above_2se:.1f}".format(**row)
        steps = "–" if row["steps"] is None else f"{row['steps']:.0f}"
        yield (
            "| `{policy}` | {return:.1f} ± {return_2se:.1f} | {0} | {done:.0%} ({done_low:.0%} to "
            "{done_high:.0%}) | {wrong:.0%} | {1} | {metres:.1f} | {contacts:.1f} | {scans:.0f} |"
        ).format(above, steps, **row)


def _mean(name: str, values: Floats) -> dict[str, float]:
    error = 2 * values.std(ddof=min(1, len(values) - 1)) / math.sqrt(len(values))
    return {name: float(values.mean()), f"{name}_2se": float(error)}


def main() -> None:
    """Print the tables asked for."""
    parser = argparse.ArgumentParser(prog="python docs/examples/acting/scores.py", description=(
        "Scores of reference policies. Return: mean ± two standard errors; steps: the median over "
        "all episodes, those not done as endless, – if that is endless."))  # fmt: skip
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"of {', '.join(SCORED)}; all")
    parser.add_argument("--policies", help="some of the task's, separated by commas without space")
    parser.add_argument("--episodes", type=int, default=20, help="seeds 0, 1, …; default 20")
    parser.add_argument("--films", type=Path, metavar="DIR", help="films only: TASK-POLICY.webp, "
        "the episode of seed 0")  # fmt: skip
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the scores there, too")
    parser.add_argument("--jobs", type=int, default=2, help="processes; default 2")
    given = parser.parse_args()
    for name, value in (("--episodes", given.episodes), ("--jobs", given.jobs)):
        if value < 1:
            parser.error(f"{name} is {value}, but must be 1 or more")
    rows = []
    for task in given.tasks or SCORED:
        if task not in SCORED:
            parser.error(f"unknown task {task!r}: choose from {', '.join(SCORED)}")
        policies = list(SCORED[task]) if given.policies is None else given.policies.split(",")
        for policy in policies:
            if policy not in SCORED[task]:
                known = ", ".join(SCORED[task])
                parser.error(f"unknown policy {policy!r} of {task}: choose from {known}")
        if given.films is not None:
            for name in policies:
                write_bytes(given.films / f"{task}-{name}.webp", film(task, name))
            continue
        print(f"\n{task}, {given.episodes} episodes\n")
        with ProcessPoolExecutor(given.jobs) as pool:
            seeds = range(given.episodes)
            waiting = {name: pool.map(play, repeat(task), repeat(name), seeds) for name in policies}
            played = {name: list(episodes) for name, episodes in waiting.items()}
        print("\n".join(table(played)), flush=True)
        rows += [{"id": task, **row} for row in summary(played)]
        if given.csv is not None:
            pd.DataFrame(rows).to_csv(given.csv, index=False)


if __name__ == "__main__":
    main()
