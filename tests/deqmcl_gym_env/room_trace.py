"""200 steps of some rooms, made with nothing but gymnasium: run here or as a process."""

import sys

import gymnasium as gym
import numpy as np

ROOM_ID = "deqmcl_gym:deqmcl_gym/Room-v0"
STEPS = 200
WORLDS = {
    "paper": {},
    "guided": {"preset": "guided"},
    "otherwise": {"clutter": {}, "people": {}},
}


def _trace(seed: int, world: str) -> dict[str, np.ndarray]:
    """Everything the env says in ``STEPS`` steps: the plan, and every 7th step something else."""
    env = gym.make(ROOM_ID, **WORLDS[world], lidar={"beams": 3}, ends_at_goal=False)
    agent = np.random.default_rng(99)
    scan, info = env.reset(seed=seed)
    said = [(scan, 0.0, False, False, info)]
    for step in range(STEPS):
        planned = info["planned_actions"][0]
        low, high = env.action_space.low, env.action_space.high
        other = agent.uniform(low, high).astype(np.float32)
        said.append(env.step(other if step % 7 == 6 else planned))
        info = said[-1][4]
    scans, rewards, terminated, truncated, infos = zip(*said, strict=True)
    arrays = {
        "scans": np.array(scans),
        "rewards": np.array(rewards),
        "terminated": np.array(terminated),
        "truncated": np.array(truncated),
    }
    for key in infos[0]:
        arrays[f"info {key}"] = np.array([info[key] for info in infos])
    return arrays


def traces(seed: int) -> dict[str, np.ndarray]:
    return {f"{world} {key}": said for world in WORLDS for key, said in _trace(seed, world).items()}


if __name__ == "__main__":
    np.savez(sys.argv[1], **traces(int(sys.argv[2])))
