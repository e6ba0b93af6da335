"""Generated kernels, which import numba only when they are compiled."""

import subprocess
import sys

import numba
import numpy as np

from kaneflex.support import late_numba


def test_numba_is_imported_by_the_first_call():
    code = """
import sys
import numpy as np
from kaneflex.generated import beam_euler_bernoulli as beam
before = "numba" in sys.modules
beam.M(np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.zeros((6, 6)))
print(before, "numba" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == ["False", "True"], done.stderr


def test_other_compiled_functions_call_it_and_it_looks_like_numbas():
    from kaneflex.generated import beam_euler_bernoulli as beam

    @numba.njit
    def mass(p, out):
        beam.M(p, out)
        return out[0, 0]

    p, out, own = np.array([1.1, 3e7, 1500.0, 0.03, 0.06]), np.zeros((6, 6)), np.zeros((6, 6))
    assert mass(p, out) == out[0, 0] > 0.0
    beam.M(p, own)
    np.testing.assert_array_equal(own, out)
    assert beam.M.__name__ == beam.M.py_func.__name__ == "M" and beam.M.signatures


def test_functions_made_within_others_are_numbas():
    """They share their name and file, not what they enclose."""

    def raised(power):
        @late_numba.njit()
        def power_of(x):
            return x**power

        return power_of

    assert (raised(2)(3), raised(3)(3)) == (9, 27)
    assert not isinstance(raised(2), late_numba.Kernel)
