"""The printer of C: what its subset of Python means in C, and what it refuses."""

import ctypes
import math
from collections import namedtuple
from types import FunctionType

import numpy as np
import pytest
from numba import njit, types
from test_c import HEADS, SHARED, built

from kaneflex.derive.printers.c_printer import Printer
from kaneflex.derive.printers.c_types import Square
from kaneflex.multibody.compile.values import Vectors, by_size

D, Z = types.float64, types.complex128
Body = namedtuple("Body", "n place mass")


@njit
def plane(a, b):
    """a . b of two vectors of 3 numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit
def space(a, b):
    """a . b of two vectors of 6 numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


dot = by_size(plane, space)


@njit
def axpy(s, a, b):
    return s * a[0] + b[0], s * a[1] + b[1], s * a[2] + b[2]


@njit
def wide(a, x):
    return a[0], a[1], a[2], x, x, x


@njit
def vectors(x, y):
    """Tuples as values: assigned, returned, passed, chosen, indexed by a variable."""
    a = (x, y, 2.0)
    b = axpy(y, a, a) if x > 0.0 else a
    six = wide(b, x)
    total = dot(a, b) + dot(six, six) + x**2  # printed as a product
    for k in range(3):
        total += b[k] * k
    if y > 0.0:
        b = axpy(2.0, b, a)
    first, _, last = b
    body = Body(2, b, x)
    n, _, mass = body
    return total + first - last + mass * body.place[1] * n + body[2] * body.n


@njit
def pairs(z, x):
    """Complex numbers beside real ones."""
    size = 0
    for _ in range(2):
        size = axpy(size, (size, size, size), (x, x, x))[0]  # first printed for whole numbers, which nobody calls
    w = complex(x, 2.0) * z + size
    v = dot((w, z, z), (w, z, w))
    return (v / z).real - (-w).imag + abs(v) + x.imag + complex(x).real


def test_vectors_and_complex_numbers_are_those_of_numba(compiler, tmp_path):
    printer = Printer()
    printer.function(vectors, (D, D), "", "vectors")
    printer.function(pairs, (Z, D), "", "pairs_of")
    text = HEADS + printer.text() + "double pairs(double x, double y, double s) { return pairs_of(CMPLX(x, y), s); }\n"
    library = ctypes.CDLL(str(built({"vectors.c": text}, tmp_path, compiler, *SHARED, level="-O2")))
    for function, count in ((library.vectors, 2), (library.pairs, 3)):
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * count
    for x, y, s in np.random.default_rng(1).normal(size=(20, 3)):
        assert library.vectors(x, y) == pytest.approx(vectors(x, y), rel=1e-13)
        assert library.pairs(x, y, s) == pytest.approx(pairs(complex(x, y), s), rel=1e-13)


@njit
def factorised(v, z, A, n):
    """Rows of vectors stored whole, real ones among complex ones, and an elimination in a matrix."""
    for j in range(n):
        v[j] = axpy(2.0, v[j], v[0])
        z[j] = v[j]
        z[j] = axpy(z[j][1], z[j], v[j])
    for i in range(n):
        for k in range(i):
            A[i, i] -= A[i, k] * v[k][0]
        if A[i, i] == 0.0:
            return False
        A[i, i] = 1.0 / A[i, i]
    return True


class Rows:
    """An array whose rows are tuples."""

    def __init__(self, array):
        self.array = array

    def __getitem__(self, k):
        return tuple(self.array[k]) if isinstance(k, int) else self.array[k]

    def __setitem__(self, k, value):
        self.array[k] = value


def test_vectors_and_matrices_at_addresses_are_those_of_python(compiler, tmp_path):
    printer, n = Printer(), 4
    printer.function(factorised, (Vectors(D, 3), Vectors(Z, 3), Square(), types.int64), "", "factorised")
    arguments = "(several_ddd *v, several_zzz *z, double A[6][6], int64_t n)"
    text = f"{HEADS}{printer.text()}bool call{arguments};\nbool call{arguments}\n{{ return factorised(v, z, A, n); }}\n"
    library = ctypes.CDLL(str(built({"vectors.c": text}, tmp_path, compiler, *SHARED)))
    random = np.random.default_rng(2)
    given = random.normal(size=(n, 3)), np.zeros((n, 3), complex), random.normal(size=(6, 6))
    expected, found = ([each.copy() for each in given] for _ in range(2))
    of_python = FunctionType(factorised.py_func.__code__, {"axpy": axpy.py_func})
    assert of_python(*(Rows(each) for each in expected), n)
    library.call.restype = ctypes.c_bool
    assert library.call(*(ctypes.c_void_p(each.ctypes.data) for each in found), ctypes.c_int64(n))
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-14)


REFUSED = {
    "a list": ("return [x, x][0]", r"\[x, x\]"),
    "a slice": ("return w[1:]", r"w\[1:\]"),
    "a string": ("y = 'text'\n    return y", "'text'"),
    "an unknown function": ("return sum((x, 1.0))", r"sum\(\(x, 1.0\)\)"),
    "a largest number among others than floats": ("return max(x, n)", r"max\(x, n\)"),
    "no statement": ("if n > 0:\n        pass\n    return x", "pass"),
    "a named argument": ("return math.hypot(x, y=x)", "hypot"),
    "an order of complex numbers": ("return complex(x, x) < complex(x, 1.0)", "complex"),
    "a power of whole numbers": ("return n ** n", r"n \*\* n \(a power"),
    "a loop over an array": ("for y in w:\n        x += y\n    return x", "for y in w:"),
    "a loop by a varying step": ("for k in range(0, n, n):\n        x += k\n    return x", "must be a constant"),
    "a tuple beside a number": ("y = x\n    y = (x, x)\n    return y[0]", "y .*beside"),
    "a tuple by a place that it has not": ("y = (x, x)\n    return y[2]", r"y\[2\]"),
    "a number in a place for whole ones": ("y = k[0] = x\n    return y", "whole numbers in a chain"),
    "an assertion": ("assert x > 0.0\n    return x", "assert"),
    "the rest of a loop": ("while x > 1.0:\n        x -= 1.0\n    else:\n        x = 0.0\n    return x", "while"),
    "itself": ("return f(w, k, n, x)", "it calls itself"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_outside_of_the_subset_is_named(name, tmp_path):
    text, construct = REFUSED[name]
    path = tmp_path / "outside.py"
    path.write_text(f"def f(w, k, n, x):\n    {text}\n")
    known = {"math": math, "__name__": "outside"}
    exec(compile(path.read_text(), str(path), "exec"), known)
    known["f"].py_func = known["f"]  # as of a compiled function
    kinds = types.CPointer(D), types.CPointer(types.int64), types.int64, D
    with pytest.raises(NotImplementedError, match=rf"not printed in C: .*{construct}") as error:
        Printer().function(known["f"], kinds)
    place, _, said = str(error.value).partition(": function f: not printed in C: ")
    assert said[:2] in path.read_text().splitlines()[int(place.rpartition(":")[2]) - 1]
