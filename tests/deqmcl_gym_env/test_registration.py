"""The environment is registered without loading Gymnasium, whoever is imported first."""

import subprocess
import sys

import pytest

MAKE = 'assert gymnasium.make("deqmcl_gym/Room-v0").reset(seed=1)[1]["planned_count"] == 204'
MANY = 'gymnasium.make_vec("{}deqmcl_gym/Room-v0", num_envs=2, vectorization_mode="{}")'


def run(code: str) -> None:
    subprocess.run([sys.executable, "-W", "error::UserWarning", "-c", code], check=True)


@pytest.mark.parametrize(
    ("code", "forbidden"),
    [
        ("import localizers; localizers.names()", {"gymnasium", "pymunk", "cv2", "benchmarks"}),
        ("import deqmcl_gym.maps", {"gymnasium", "pymunk", "cv2", "benchmarks", "localizers"}),
        (f"import gymnasium; {MANY.format('deqmcl_gym:', 'vector_entry_point')}", {"pymunk"}),
    ],
)
def test_what_is_not_needed_is_not_loaded(code, forbidden):
    run(f"{code}; import sys; seen = set(sys.modules) & {forbidden}; assert not seen, seen")


@pytest.mark.parametrize(
    "code",
    [
        f"import deqmcl_gym, gymnasium; {MAKE}",
        f"import gymnasium, deqmcl_gym; {MAKE}",
        f"import localizers, gymnasium; {MAKE}",
        f"import deqmcl_gym, importlib, gymnasium.envs.registration; {MAKE}",
        f"import gymnasium; gymnasium.make('deqmcl_gym:deqmcl_gym/Room-v0'); {MAKE}",
        f"import deqmcl_gym, gymnasium; {MANY.format('', 'vector_entry_point')}.reset(seed=1)",
        f"import gymnasium; {MANY.format('deqmcl_gym:', 'sync')}.reset(seed=1)",
    ],
)
def test_the_id_is_known_in_whatever_order_things_are_imported(code):
    run(code)


def test_gymnasiums_own_module_is_as_without_us():
    run(
        "import deqmcl_gym, sys, gymnasium.envs.registration as registry; "
        "assert 'importlib' in type(registry.__loader__).__module__; "
        "assert registry.__spec__.loader is registry.__loader__; "
        "assert not [f for f in sys.meta_path if type(f).__module__.startswith('deqmcl')]"
    )
