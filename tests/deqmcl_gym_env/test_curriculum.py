"""Curriculum: when it goes on, what it tells, and what it refuses."""

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from refusals import refused

import deqmcl_gym  # noqa: F401  # registers the environments
from deqmcl_gym.envs.wrappers import Curriculum

SIZE = gym.spaces.Box(0, 1, (1,), np.float32)


class Task(gym.Env):
    """Ends after a step, done if the action is 1; shows a random number."""

    observation_space, action_space = SIZE, SIZE

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._seen(), {}

    def step(self, action):
        return self._seen(), 0.0, True, False, {"is_success": bool(action[0] == 1)}

    def _seen(self):
        return self.np_random.random(1, np.float32)


def stages(env, successes, seed=0):
    """The stage of each episode, and what is seen at its start."""
    found = []
    for number, success in enumerate(successes):
        seen, info = env.reset(seed=seed if number == 0 else None)
        found.append((info["stage"], float(seen[0])))
        *_, told = env.step(np.array([success], np.float32))
        assert told["stage"] == info["stage"]
    return found


def test_it_goes_on_when_enough_of_the_last_episodes_of_a_stage_were_done():
    env = Curriculum([Task(), Task(), Task()], success=0.5, window=4)
    done = [0, 0, 1, 0, 1, 1, 0, 1, 1, 0, 0, 0, 0]
    # after five episodes two of the last four were done; counting starts again at stage 1
    assert [stage for stage, _ in stages(env, done)] == [0] * 5 + [1] * 4 + [2] * 4


def test_the_first_seed_determines_the_episodes_of_all_stages():
    one, same = (stages(Curriculum([Task(), Task()], window=2), [1] * 6, seed=5) for _ in "ab")
    other = stages(Curriculum([Task(), Task()], window=2), [1] * 6, seed=6)
    assert one == same
    assert not {seen for _, seen in one} & {seen for _, seen in other}


def test_an_env_that_does_not_tell_success_is_done_by_termination():
    env = Curriculum([gym.make("deqmcl_gym/Sharp-v0", max_episode_steps=1) for _ in range(2)],
                     success=0.0, window=1)  # fmt: skip
    _, info = env.reset(seed=0)
    *_, truncated, info = env.step(info["planned_actions"][0])
    assert truncated
    assert env.reset()[1]["stage"] == 1
    strict = Curriculum(env._envs, success=0.1, window=1)
    _, info = strict.reset(seed=0)
    strict.step(info["planned_actions"][0])
    assert strict.reset()[1]["stage"] == 0
    env.close()


def test_stages_of_other_spaces_none_at_all_and_bad_thresholds_are_refused():
    few, many = (gym.make("deqmcl_gym/Sharp-v0", lidar={"beams": beams}) for beams in (3, 9))
    with refused("stage 1 has the observation_space", "stage 0"):
        Curriculum([few, many])
    with refused("envs is empty"):
        Curriculum([])
    for name, value in (("success", 1.5), ("window", 0)):
        with refused(name):
            Curriculum([Task()], **{name: value})


def test_seeded_actions_are_the_same_in_every_run_and_observations_within_one_space():
    def drawn():
        made = [Task(), Task()]
        made[1].action_space = gym.spaces.Box(0, 1, (1,), np.float32)
        made[1].observation_space = gym.spaces.Box(-2, 0.5, (1,), np.float32)
        env = Curriculum(made, success=0.0, window=1)
        env.action_space.seed(1)
        actions = []
        for _ in range(3):
            assert env.reset(seed=0)[0] in env.observation_space
            actions.append(float(env.action_space.sample()[0]))
            env.step(np.float32([0.0]))
        assert env.observation_space == gym.spaces.Box(-2, 1, (1,), np.float32)
        return actions

    assert drawn() == drawn()


def test_a_spec_makes_the_same_stages_again_also_by_json():
    stages = [gym.make("deqmcl_gym/Sharp-v0", max_episode_steps=most) for most in (2, 3)]
    env = Curriculum(stages, success=0.0, window=1)
    assert env.spec.max_episode_steps == 3
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json())):
        again = gym.make(spec, render_mode="rgb_array")
        for seed in (4, None):
            np.testing.assert_equal(again.reset(seed=seed), env.reset(seed=seed))
            while not env.step(np.float32([1, 0]))[3]:
                assert not again.step(np.float32([1, 0]))[3]
            assert again.step(np.float32([1, 0]))[3]
        assert again.render().ndim == 3
        env = Curriculum(stages, success=0.0, window=1)
    assert Curriculum([Task()]).spec is None
