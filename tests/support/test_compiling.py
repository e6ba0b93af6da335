"""While numba compiles: operators are what they were, and garbage is collected afterwards as before.

Reading compiled functions does not prepare numba to compile.
"""

import gc
import itertools
import json
import math
import operator
import pickle
import subprocess
import sys
from types import FunctionType, SimpleNamespace

import numba
import numpy as np
import pytest
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction

from kaneflex import load, read_scene
from kaneflex.generated.tables import table
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.multibody import engine
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.model.layout import Kind
from kaneflex.multibody.time.rigid_reference import rigid_reference
from kaneflex.support import inner
from kaneflex.support.inner import PART

KINDS = (types.boolean, types.int64, types.uint8, types.literal(3), types.literal(-1), types.float32, types.float64)
ROW, MATRIX, PAIR = types.float64[::1], types.float64[:, ::1], types.UniTuple(types.int64, 2)


@pytest.fixture(autouse=True)
def quick():
    inner.prepare()


@pytest.mark.parametrize("often", [(700, 10, 10), (0, 10, 10)])
def test_garbage_is_collected_as_before(often):
    """Also where what is compiled is wrong, and where a program collects none."""
    before = gc.get_threshold()
    gc.set_threshold(*often)
    try:
        with pytest.raises(ArithmeticError), event.trigger_event("numba:compile"):
            with event.trigger_event("numba:compile"):
                pass
            assert (gc.get_threshold()[0] > often[0]) == (often[0] > 0)
            raise ArithmeticError
        assert gc.get_threshold() == often
    finally:
        gc.set_threshold(*before)


def told(find, function, context, args):
    """What a search finds, and the key by which the operator is compiled then."""
    signature = find(function, context, args, {})
    return signature.return_type, signature.args, function.get_impl_key(signature)


@pytest.mark.parametrize("name", ["add", "sub", "mul", "truediv", "pow", "iadd", "eq", "ne", "lt", "ge"])
def test_a_remembered_operator_is_the_one_that_numba_finds(name):
    """For every two kinds of numbers, whichever came before, and for arrays."""
    context, kinds = cpu_target.typing_context, [*KINDS, *[types.complex128] * (name not in ("lt", "ge"))]
    context.refresh()
    function = context.resolve_value_type(getattr(operator, name))
    for _ in range(2):
        for pair in (*itertools.product(kinds, kinds), (ROW, types.float64)):
            own = told(BaseFunction.get_call_type, function, context, pair)
            assert told(type(function).get_call_type, function, context, pair) == own, pair


@pytest.mark.parametrize(("name", "args"), [
    ("getitem", (ROW, types.int64)), ("getitem", (ROW, types.literal(3))), ("getitem", (MATRIX, PAIR)),
    ("setitem", (ROW, types.uint64, types.float64)), ("setitem", (MATRIX, PAIR, types.int64)),
])  # fmt: skip
def test_so_are_the_places_of_arrays(name, args):
    context = cpu_target.typing_context
    context.refresh()
    function = context.resolve_value_type(getattr(operator, name))
    own = told(BaseFunction.get_call_type, function, context, args)
    for _ in range(2):
        assert told(type(function).get_call_type, function, context, args) == own


def test_an_operator_is_looked_for_once(monkeypatch):
    """Of all that numba knows of it nothing is asked again where it is used a second time."""
    numba.njit(lambda x: x)(1.0)  # the first function that a process compiles registers what numba knows
    context = cpu_target.typing_context
    context.refresh()
    function = context.resolve_value_type(operator.add)
    function.get_call_type(context, (types.float64, types.float64), {})
    asked = []
    for template in function.templates:
        monkeypatch.setattr(template, "apply", lambda self, args, kws: asked.append(args))

    @numba.njit
    def doubled(x):
        return x + x

    function._impl_keys[types.float64, types.float64] = "what another search said"
    assert doubled(np.float64(2.0)) == 4.0
    assert not asked


def test_what_numba_compiles_for_a_call_is_not_remembered():
    """It depends on more than the types: on how what calls it is compiled."""

    def halved(x):
        raise NotImplementedError

    numba.extending.overload(halved)(lambda x: lambda x: x / 2.0)
    found = {}
    for model in ("python", "numpy"):
        found[model] = numba.njit(lambda x: halved(x) / x, error_model=model)
    assert np.isnan(found["numpy"](0.0))
    with pytest.raises(ZeroDivisionError):
        found["python"](0.0)


def test_a_kernel_that_compiled_code_calls_is_compiled_with_it_and_not_by_itself():
    """By itself it is compiled when Python calls it."""
    kernel = numba.njit(table.py_func)
    block = np.array([1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0])

    @numba.njit
    def doubled(x, p):
        return 2.0 * kernel(x, p, 0)

    expected = 2.0 + 0.4 * (3.0 + 0.4 * (4.0 + 0.4 * 5.0))
    assert doubled(0.4, block) == pytest.approx(2.0 * expected)
    assert not kernel.overloads
    assert kernel(0.4, block, 0) == pytest.approx(expected)
    assert len(kernel.overloads) == 1


def test_functions_without_a_module_are_compiled_beside_kernels():
    """As those of sympy.lambdify are."""
    made = FunctionType((lambda x: 2.0 * x).__code__, {"__name__": None})
    doubled = numba.njit(made)

    @numba.njit
    def summed(x):
        return doubled(x) + 1.0

    assert made.__module__ is None and summed(1.5) == 4.0


def test_parts_are_linked_once_by_what_encloses_them():
    """A part that calls others holds its own code alone; int() is a function that numba compiles and links, too."""

    @numba.njit(**PART)
    def floored(x):
        return int(x) + 1

    @numba.njit(**PART)
    def doubled(x):
        return 2 * floored(x)

    @numba.njit
    def both(x):
        return doubled(x) + floored(x + 0.5)

    assert both(3.7) == 13
    (part,) = doubled.overloads.values()
    assert len(list(part.library.get_defined_functions())) == 1


def test_a_rigid_reference_has_no_library_of_its_own(monkeypatch):
    """It uses that of its mechanism, though it has none of the contacts: a second one takes as long to compile."""
    scene = read_scene("slider-crank-clearance")
    system, _ = build_system(scene, lambda stage: None, 3)
    asked = []
    monkeypatch.setattr(engine, "library", lambda kind, integrates: asked.append(kind))
    rigid = rigid_reference(system, place(mechanism_of(scene))).module
    for each in (system.engine, rigid.engine, pickle.loads(pickle.dumps(rigid.engine))):
        each._library  # noqa: B018 - which asks for the library
    assert len(asked) == 3
    assert set(asked) == {Kind.CONTACTS}


READ = """
import json, math, sys
import numba, numpy as np
import kaneflex
from kaneflex.generated import spatial_shapes
from kaneflex.generated.tables import table
from kaneflex.mechanism.position_analysis import place
from kaneflex.multibody import engine
from kaneflex.multibody.time.rigid_reference import rigid_reference
from kaneflex.multibody.model.assembly import build_system


@numba.njit
def later(block):
    return math.gamma(table(0.4, block, 0)) * block[::2].sum()


def prepared():
    return "numba.np.linalg" in sys.modules


model = kaneflex.load(kaneflex.read_scene("engine"))
kernels = model.kernels
out, block = np.empty(2 * (len(kernels.coordinates),)), np.array([1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
kernels.K(1e-3, kernels.parameters, out)
first, before = table(0.4, block, 0), prepared()
compiled = later(block)
kernels.M(1e-3, kernels.parameters, mass := np.empty_like(out))
print(json.dumps([out.tolist(), mass.tolist(), first, table(0.4, block, 0), compiled, before, prepared()]))
"""


def test_compiled_functions_are_read_without_preparing_to_compile():
    """Another process that reads them gets the same numbers, and compiles afterwards what calls them."""
    block, kernels = np.array([1.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0]), load(read_scene("engine")).kernels
    stiffness, mass = np.empty((2, *2 * (len(kernels.coordinates),)))
    kernels.K(1e-3, kernels.parameters, stiffness)
    kernels.M(1e-3, kernels.parameters, mass)
    value = table(0.4, block, 0)
    assert value == pytest.approx(2.0 + 0.4 * (3.0 + 0.4 * (4.0 + 0.4 * 5.0)))
    done = subprocess.run([sys.executable, "-c", READ], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    *read, compiled, before, after = json.loads(done.stdout)
    assert read == [stiffness.tolist(), mass.tolist(), value, value]
    assert compiled == pytest.approx(math.gamma(value) * block[::2].sum())
    assert (before, after) == (False, True)


def test_functions_of_other_packages_are_read_as_numba_reads_them(monkeypatch):
    """What these need is not known."""
    asked = []
    monkeypatch.setattr(cpu_target.target_context, "refresh", lambda: asked.append(True))
    monkeypatch.setattr(FunctionCache, "_load_overload", lambda self, sig, context: sig)
    for module, refreshes in (("kaneflex.generated.laws", 0), ("kaneflex_3302ebbbfc4bb91f", 0), ("other", 1)):
        cache = FunctionCache.__new__(FunctionCache)
        cache._py_func = SimpleNamespace(__module__=module)
        assert cache.load_overload("signature", cpu_target.target_context) == "signature"
        assert len(asked) == refreshes
