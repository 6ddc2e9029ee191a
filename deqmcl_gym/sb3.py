"""Native vector environments for Stable-Baselines3: ``Rooms(gym.make_vec(...))`` is a ``VecEnv``.

Needs the extra ``rl``: ``pip install "deqmcl-gym[rl]"``.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from deqmcl_gym.validation import InputError

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError(
        'Stable-Baselines3 is not installed: pip install "deqmcl-gym[rl]".', name=missing.name
    ) from None


class Rooms(VecEnv):  # type: ignore[misc, unused-ignore]
    """Environments that run together, with actions in [-1, 1], or numbers if they are discrete.

    Args:
        rooms: of ``gym.make_vec(..., autoreset_mode="SameStep")``. It is the attribute ``rooms``.
    """

    def __init__(self, rooms: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        mode = rooms.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise InputError(
                f"the rooms have autoreset_mode {mode}, but Stable-Baselines3 begins an episode in "
                'the step that ends one: give gym.make_vec(..., autoreset_mode="SameStep").'
            )
        self.rooms = rooms
        space: Any = rooms.single_action_space
        self._box = space if isinstance(space, gym.spaces.Box) else None
        if self._box is not None:
            space = gym.spaces.Box(-1.0, 1.0, space.shape, np.float32)
        super().__init__(rooms.num_envs, rooms.single_observation_space, space)

    def reset(self) -> Any:
        """Begin an episode in all rooms, with the seeds given before, if any."""
        seeds = None if None in self._seeds else self._seeds
        self._reset_seeds()
        seen, _ = self.rooms.reset(seed=seeds)
        return seen

    def step_async(self, actions: Any) -> None:
        """Take actions, one for each room."""
        if (box := self._box) is not None:
            actions = box.low + (np.clip(actions, -1, 1) + 1) * ((box.high - box.low) / 2)
            actions = np.clip(actions, box.low, box.high).astype(np.float32)  # rounding
        self._actions = actions

    def step_wait(self) -> Any:
        """Step all rooms; where an episode ends, the next one begins."""
        seen, rewards, terminated, truncated, info = self.rooms.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for room in np.flatnonzero(terminated | truncated):
            infos[room]["terminal_observation"] = info["final_obs"][room]
            infos[room]["TimeLimit.truncated"] = bool(truncated[room] and not terminated[room])
            infos[room]["is_success"] = bool(info["final_info"]["is_success"][room])
        return seen, rewards.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Close the rooms."""
        self.rooms.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return what all rooms share, once for each."""
        return [getattr(self.rooms, attr_name)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: rooms have no wrappers of their own."""
        return [False] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: rooms are equal."""
        raise NotImplementedError("rooms that run together are equal: make others instead.")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Refuse: rooms that run together have no methods of their own."""
        raise NotImplementedError("rooms that run together have no methods of their own.")
