"""A localizer needs the map, NumPy and numba: neither the physics nor the drawing gets loaded.

Gymnasium does get loaded: ``import deqmcl_gym`` registers the environment.
"""

import subprocess
import sys


def loaded_by(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {name.split(".")[0] for name in done.stdout.split()}


def test_importing_localizers_loads_neither_pymunk_nor_opencv():
    loaded = loaded_by("import localizers; localizers.names()")
    assert {"localizers", "deqmcl_gym", "numpy", "numba"} <= loaded
    assert not loaded & {"pymunk", "cv2", "benchmarks"}


def test_importing_the_floor_plan_loads_neither_pymunk_nor_opencv_nor_the_localizers():
    loaded = loaded_by("import deqmcl_gym.maps")
    assert not loaded & {"pymunk", "cv2", "localizers", "benchmarks"}


def test_the_check_sees_what_is_loaded():
    assert "pymunk" in loaded_by("import pymunk")
