"""Many rooms as one native vector env, and as Gymnasium's around single ones."""

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

# Contacts by pymunk and by the kernel differ by rounding errors, some 1e-13 px a step; ranges from
# poses rounded to float32 are off by 3e-5 px, along a slant more.
NEAR = {"truth": 1e-3, "reward": 1e-3, "progress": 1e-5, "scan": 1e-2}
TO_THE_BIT: dict[str, float] = {}


def both(name: str, rooms: int, mode: str = "NextStep", **kwargs):
    native = gym.make_vec(name, num_envs=rooms, autoreset_mode=mode, **kwargs)
    kwargs |= {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": mode}}
    return native, gym.make_vec(name, num_envs=rooms, **kwargs)


def assert_same(ours, theirs, near=TO_THE_BIT, what="the step") -> None:
    """Same keys, types and shapes; numbers near, everything that is no measure equal."""
    if isinstance(theirs, dict):
        assert ours.keys() == theirs.keys()
        for key in theirs:
            assert_same(ours[key], theirs[key], near, key)
    elif isinstance(theirs, tuple):
        names = ("scan", "reward", "ended", "cut", "info") if len(theirs) == 5 else ("scan", "info")
        for name, *pair in zip(names, ours, theirs, strict=True):
            assert_same(*pair, near, name)
    elif theirs.dtype == object:  # final_obs
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) == (other is None)
            if other is not None:
                what = "scan" if isinstance(other, np.ndarray) else what
                assert_same(one, other, near, what)
    else:
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), what
        if ours.tobytes() != theirs.tobytes():
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=near.get(what, 0), err_msg=what)


def run_beside(envs, steps, planned, seed, near=TO_THE_BIT) -> tuple[int, int]:
    """Run both, with such a share of planned actions, and count contacts and ends."""
    agent, (_, loop) = np.random.default_rng(seed), envs
    said = [env.reset(seed=seed) for env in envs]
    assert_same(*said, near)
    plans = said[1][1]["planned_actions"]
    low, high = loop.action_space.low, loop.action_space.high
    contacts = ends = 0
    for _ in range(steps):
        follow = agent.random((loop.num_envs, 1)) < planned
        anything = agent.uniform(low, high).astype(np.float32)
        actions = np.where(follow, plans[:, 0], anything).clip(low, high)
        ours, theirs = (env.step(actions) for env in envs)
        assert_same(ours, theirs, near)
        plans = theirs[4]["planned_actions"]
        contacts += int(theirs[4]["collided"].sum())
        ended = theirs[2] | theirs[3]
        ends += int(ended.sum())
        if loop.metadata["autoreset_mode"] is AutoresetMode.DISABLED and ended.any():
            said = [env.reset(options={"reset_mask": ended.copy()}) for env in envs]
            assert_same(*said, near)
            plans[ended] = said[1][1]["planned_actions"][ended]
    return contacts, ends
