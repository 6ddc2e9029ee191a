"""Score a policy of Gymnasium's kind in our environments, beside a reference in the same episodes.

``benchmarks.evaluate("Localize-v0", policy)``. The policies of ``REFERENCES`` see what the env
shows, and the belief where there is one; only ``route`` sees the true pose. In ``Localize-v0`` all
declare when ``confident`` is 1, in ``Track-v0`` when 90 % of the belief is at the goal.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from tqdm.auto import tqdm

import deqmcl_gym  # noqa: F401 # registers the environments
from benchmarks.agents import AGENTS
from benchmarks.tables.stats import wilson
from deqmcl_gym.envs.acting import ActingEnv, TrackEnv
from deqmcl_gym.maps.map import metre
from deqmcl_gym.numerics import Floats, Singles
from deqmcl_gym.validation import InputError, integer, one_of, shown
from localizers.tasks import BEAM_POWER, OFFICE, robot_model

Policy = Callable[[Any, dict[str, Any]], Any]  # policy(observation, info) returns an action
Wrap = Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]

BUILDINGS = 20  # of Localize-v0: episode k takes place in the office of seed k modulo this
_SURE = 0.9
_VAGUE = 0.1  # of the tolerance: standard deviation from which on a scan is taken
_PLAIN = ("still", "spin", "random")
_SENSING = {
    **dict.fromkeys(_PLAIN, "never"),
    "to-goal": "always",
    "to-goal-blind": "never",
    "to-goal-if-vague": "if vague",
    "free-energy": "if vague",
}
_DRIVER = {"plan": "open-loop", "to-goal-blind": "to-goal", "to-goal-if-vague": "to-goal"}
REFERENCES: Mapping[str, tuple[str, ...]] = {  # by environment, without its ``deqmcl_gym/``
    **{f"{name}-v0": (*_PLAIN, "plan") for name in ("Room", "Matched", "Sharp", "Guided")},
    "Journey-v1": (*_PLAIN, "plan"),
    "Localize-v0": (*_PLAIN, "wall-follower", "route", "greedy", "four-deep", "free-energy"),
    "Track-v0": tuple(_SENSING),
}


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a policy reached.

    ``episodes`` has a row each: return, done (the task), wrong (a declaration), steps, metres
    driven, contacts, scans; its index are the seeds.
    """

    task: str
    policy: str
    episodes: pd.DataFrame
    reference: "Evaluation | None" = None  # in the same episodes

    @cached_property
    def row(self) -> pd.Series:
        """Means over episodes; ± is two standard errors, done has Wilson's 95 % interval.

        ``gain`` is the mean difference of the returns from the reference's in the same episodes.
        ``steps`` is the median, episodes that were not done counted as endless.
        """
        played = self.episodes
        row: dict[str, Any] = {"policy": self.policy}
        row["return"], row["±"] = _mean(played["return"])
        row["gain"], row["gain ±"] = math.nan, math.nan
        if self.reference is not None:
            row["gain"], row["gain ±"] = _mean(played["return"] - self.reference.episodes["return"])
        row["done"] = float(played["done"].mean())
        row["done low"], row["done high"] = wilson(row["done"], len(played))
        row["wrong"] = float(played["wrong"].mean())
        row["steps"] = float(played["steps"].where(played["done"], math.inf).median())
        row |= {name: float(played[name].mean()) for name in ("metres", "contacts", "scans")}
        return pd.Series(row)

    def __str__(self) -> str:
        """Return the row in a line of words."""
        row = self.row
        gain = "" if self.reference is None else (
            f" ({row['gain']:+.1f} ± {row['gain ±']:.1f} against {self.reference.policy})"
        )  # fmt: skip
        return (
            f"{self.policy} in {self.task}, {len(self.episodes)} episodes: return "
            f"{row['return']:.1f} ± {row['±']:.1f}{gain}, done {row['done']:.0%} "
            f"({row['done low']:.0%} to {row['done high']:.0%})"
        )

    __repr__ = __str__


def evaluate(
    task: str,
    policy: Any,
    *,
    episodes: int = 100,
    reference: "str | Evaluation | None" = "spin",
    wrap: Wrap | None = None,
    deterministic: bool = True,
    **made: Any,
) -> Evaluation:
    """Play episodes of seeds 0, 1, … with a policy and with a reference.

    Args:
        task: an id, ``deqmcl_gym/`` may be left out.
        policy: ``policy(observation, info)``, which returns an action; a model with ``predict``, as
            of Stable-Baselines3, recurrent ones too; or a name among ``REFERENCES[task]``.
        episodes: how many. In ``Localize-v0`` episode k is in the office of seed k modulo 20,
            unless ``floor_plan`` is given: train on others.
        reference: a name among ``REFERENCES[task]``, an evaluation of the same episodes, or None.
        wrap: wrappers around each env that the policy was trained in; returns are those of the env.
        deterministic: given to ``predict``.
        made: further arguments of ``gym.make``.

    Raises:
        InputError: an unknown id or policy, or a reference of other episodes.
    """
    if not isinstance(task, str):
        raise InputError(f"the task is {shown(task)}, but must be an id, such as 'Localize-v0'.")
    name = one_of("task", task.removeprefix("deqmcl_gym/"), REFERENCES)
    count = integer("episodes", episodes, low=1)
    for named in (policy, reference):
        if isinstance(named, str):
            one_of(f"policy of {name}", named, REFERENCES[name])
    title: str = getattr(policy, "__name__", type(policy).__name__)
    title = policy if isinstance(policy, str) else title
    rows = []
    for seed in tqdm(range(count), title, disable=None, leave=False):
        office = {"floor_plan": {"office": {**OFFICE, "seed": seed % BUILDINGS}}}
        options = office if name == "Localize-v0" else {}
        env: gym.Env[Any, Any] = Counted(gym.make(f"deqmcl_gym/{name}", **options | made))
        rows.append(_played(env, policy, seed, wrap, deterministic))
        env.close()
    frame = pd.DataFrame(rows, index=pd.RangeIndex(count, name="seed"))
    if isinstance(reference, str):
        beside = {"episodes": count, "reference": None, **made}
        reference = None if reference == policy else evaluate(name, reference, **beside)
    if reference is not None and not frame.index.equals(reference.episodes.index):
        raise InputError(
            f"the reference has {len(reference.episodes)} episodes, but {count} are played: "
            "evaluate it in as many."
        )
    return Evaluation(name, title, frame, reference)


class Counted(gym.Wrapper[Any, Any, Any, Any]):
    """Counts what is driven and paid in an episode, whatever wrappers are around it."""

    def reset(self, **arguments: Any) -> Any:
        seen, info = self.env.reset(**arguments)
        self._at = info["truth"]
        self.counts = {"return": 0.0, "steps": 0, "metres": 0.0, "contacts": 0, "scans": 0}
        return seen, info

    def step(self, action: Any) -> Any:
        seen, reward, terminated, truncated, info = self.env.step(action)
        room: Any = self.unwrapped
        counts, unit = self.counts, metre(room.floor_plan.unit)
        counts["return"] += float(reward)
        counts["steps"] += 1
        counts["metres"] += math.dist(self._at[:2], info["truth"][:2]) / unit
        counts["contacts"] += int(info["collided"])
        counts["scans"] += int(seen["sensed"][0]) if isinstance(room, TrackEnv) else 1
        self._at = info["truth"]
        return seen, reward, terminated, truncated, info


def _played(
    counted: gym.Env[Any, Any], policy: Any, seed: int, wrap: Wrap | None, deterministic: bool
) -> dict[str, Any]:
    env = counted if wrap is None else wrap(counted)
    seen, info = env.reset(seed=seed)
    act = _acting(policy, env.unwrapped, seen, info, deterministic)
    terminated = truncated = False
    while not (terminated or truncated):
        seen, _, terminated, truncated, info = env.step(act(seen, info))
    done = bool(info["is_success"])
    wrong = bool(terminated) and not (done or bool(info["collided"]))
    counts = counted.counts  # type: ignore[attr-defined]
    return {"return": counts.pop("return"), "done": done, "wrong": wrong, **counts}


def _acting(policy: Any, room: Any, seen: Any, info: dict[str, Any], deterministic: bool) -> Policy:
    """Return what acts in one episode."""
    if isinstance(policy, str):
        return _reference(policy, room, seen, info)
    if not hasattr(policy, "predict"):
        return policy  # type: ignore[no-any-return]
    state, first = None, True

    def predicted(seen: Any, info: dict[str, Any]) -> Any:
        nonlocal state, first
        how = {"episode_start": np.array([first]), "deterministic": deterministic}
        action, state = policy.predict(seen, state=state, **how)
        first = False
        return int(action) if np.ndim(action) == 0 else action

    return predicted


def _reference(name: str, room: Any, seen: Any, info: dict[str, Any]) -> Policy:
    """Return a reference policy for one episode: an agent, with the heads of the env."""
    power = BEAM_POWER if isinstance(room, ActingEnv) and not isinstance(room, TrackEnv) else 1.0
    agent = AGENTS[_DRIVER.get(name, name)](robot_model(room.world, power))

    def shown(seen: Any, info: dict[str, Any]) -> dict[str, Any]:
        goal = {"goal": np.array(room.goal)} if isinstance(room, TrackEnv) else {}
        return {**info, **goal, "ranges": seen["scan"] if isinstance(seen, dict) else seen}

    def act(seen: Any, info: dict[str, Any]) -> Singles:
        if not isinstance(room, ActingEnv):
            return np.asarray(agent.act(None, shown(seen, info))[0], np.float32)  # type: ignore[arg-type]
        heads = _heads(name, room, seen)
        move = np.zeros(2) if heads[-1] else agent.act(room.belief, shown(seen, info))[0]
        return np.array([*move, *heads], np.float32)

    agent.plan_at_reset(shown(seen, info))
    return act


def _heads(name: str, room: ActingEnv, seen: Any) -> list[float]:
    """Return whether to take a scan, in ``Track-v0``, and whether to declare."""
    if not isinstance(room, TrackEnv):
        return [float(seen["confident"][0] >= 1.0)]
    poses, weights = room.belief.points()
    off: Floats = np.hypot(*(np.asarray(poses)[:, :2] - room.goal).T)
    declare = float(weights[off <= room.tolerance].sum()) > _SURE
    sensing = _SENSING[name]
    spread = math.sqrt(float(np.trace(seen["covariance"][:2, :2])))
    sense = sensing == "always" or (sensing == "if vague" and spread > _VAGUE * room.tolerance)
    return [float(sense), float(declare)]


def _mean(values: pd.Series) -> tuple[float, float]:
    """Return mean and two standard errors."""
    spread = values.std(ddof=min(1, len(values) - 1))
    return float(values.mean()), float(2 * spread / math.sqrt(len(values)))
