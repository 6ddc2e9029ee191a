"""Kernels say the same, to the bit, when Python runs them: what is debugged is what runs."""

import json
import os
import subprocess
import sys

import kernel_cases


def test_every_kernel_file_says_the_same_compiled_and_in_pure_python():
    said = subprocess.run(
        [sys.executable, "-W", "ignore", kernel_cases.__file__],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert json.loads(said) == kernel_cases.digests()
