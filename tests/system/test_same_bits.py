"""The numbers of a trial do not depend on the processor's instruction set."""

import json
import os
import platform

import numpy as np
import pytest
from deqmcl_command import python

# Every number of one trial of each localizer, by its exact bits.
DIGEST = """
import hashlib, json, msgspec
from benchmarks.trials.stage import Stage
from benchmarks.setup.scenario import Thresholds
from benchmarks.trials.scoring import record
from benchmarks.sweeps.sweepfile import paper_sweep
from localizers import names

digests = {}
for scenario in ("paper", "sharp"):
    suite = paper_sweep(
        scenario=scenario, localizers=names(), trials=1, seed=3, lag=5, particles=300
    ).distinct()
    for trial in suite:
        trace = Stage.of(trial).trace()
        arrays = [trace.truth.tobytes()]
        for kept in trace.offsets.values():
            columns = [kept.means, kept.variances, *kept.values.values()]
            arrays += [column.tobytes() for column in columns]
        done = msgspec.to_builtins(record(trace), str_keys=True)
        words = msgspec.json.encode(done, order="sorted")
        digest = hashlib.sha256(b"".join([*arrays, words])).hexdigest()
        digests[f"{scenario} {trial.localizer}"] = digest
print(json.dumps(digests))
"""


def digests(**environment: str) -> dict[str, str]:
    found: dict[str, str] = json.loads(python("-c", DIGEST, env=os.environ | environment))
    return found


@pytest.mark.slow
def test_the_same_bits_for_a_generic_processor_in_another_locale(tmp_path):
    ours = digests()
    assert ours["paper mcl"] != ours["sharp mcl"] != ours["sharp deq-mcl"]  # differences are seen
    machine = {"LC_ALL": "de_DE.UTF-8", "TZ": "Pacific/Chatham", "OMP_NUM_THREADS": "3"}
    machine |= {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path)}
    assert digests(**machine) == ours
    # without FMA, 7 of 10,000 sines of glibc 2.36 differ in their last bit
    assert digests(GLIBC_TUNABLES="glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4") == ours
    features = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    assert features, "NumPy found no extension that could be switched off"
    assert digests(NPY_DISABLE_CPU_FEATURES=" ".join(features)) == ours


FITTED = """
import numpy as np
from benchmarks.setup.logs import _explained
from localizers.models.nav2_motion import MOTION_MODELS

rng = np.random.default_rng(0)
meant = rng.normal(0.1, 0.1, (4001, 3))
done = meant * rng.normal(1.0, 0.1, meant.shape) + rng.normal(0.0, 0.02, meant.shape)
done[::7, 1] = np.nan
for model in MOTION_MODELS.values():
    print(*(float(value).hex() for value in vars(model.fitted(meant, done)).values()))
print(_explained(done[:, 2], meant[:, ::2]).tobytes().hex())
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the names of kernels are of x86-64")
def test_the_noise_fitted_to_a_log_is_the_same_with_another_blas_and_narrow_registers():
    features = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    machine = {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": " ".join(features)}
    assert python("-c", FITTED, env=os.environ | machine) == python("-c", FITTED)
