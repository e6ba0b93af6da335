"""Libraries by the C compiler: the same runs as with numba, and numba where there is no compiler."""

from contextlib import contextmanager

import numpy as np
import pytest
from runs import alike

from kaneflex import load, read_scene, simulate, with_settings
from kaneflex.integrate import stepping
from kaneflex.multibody import engine
from kaneflex.multibody.compile import entries
from kaneflex.multibody.model.layout import Kind
from kaneflex.support import c_library


def addresses():
    kind = Kind.RIGID_SPACE
    return c_library.c_addresses("prescribed", entries.sources(), lambda: engine._typed(kind, entries.PRESCRIBED))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache folder of its own, for libraries that are compiled in a moment."""
    monkeypatch.setattr(c_library, "_FLAGS", ("-O0",))
    monkeypatch.setattr(c_library, "ensure_cache_folder", lambda: tmp_path)
    return tmp_path


@contextmanager
def without_c(monkeypatch):
    """Functions that numba compiles, as where there is no C compiler."""
    caches = engine.library, stepping.stepper
    for module, cache in zip((engine, c_library), caches, strict=True):
        monkeypatch.setattr(module, "c_addresses", lambda *of: [])
        cache.cache_clear()
    yield
    monkeypatch.undo()
    for cache in caches:
        cache.cache_clear()


SCENES = {
    "four-bar-motor": (), "slider-crank-clearance": ("solve.duration=2 ms",), "bricard": ("solve.duration=0.1 s",),
}  # fmt: skip


@pytest.mark.exhaustive  # numba compiles the engine of each kind for 15 s
@pytest.mark.parametrize("scene", SCENES)
def test_runs_are_those_of_numba(compiler, scene, monkeypatch):
    settings = with_settings(read_scene(scene), SCENES[scene])
    in_c = simulate(load(settings))
    with without_c(monkeypatch):
        by_numba = simulate(load(settings))
    alike(in_c, by_numba, 1e-9)


@pytest.mark.parametrize("method", ["radau", *(pytest.param(name, marks=pytest.mark.exhaustive)
                                               for name in ("newmark", "gauss", "exact-modal"))])  # fmt: skip
def test_steps_are_those_of_numba(compiler, method, monkeypatch):
    preset = "paper" if method == "exact-modal" else "stiffened"
    settings = [f"solve.integrator={method}", f"solve.preset={preset}", "solve.start=zero", "solve.steps=90"]
    scene = with_settings(read_scene("engine"), settings)
    in_c = simulate(load(scene))
    with without_c(monkeypatch):
        by_numba = simulate(load(scene))
    alike(in_c, by_numba, 1e-10)


def test_a_library_of_c_calls_kernels_of_numba(compiler, monkeypatch):
    """A wheel brings libraries of C to machines without a C compiler, which derive scenes of their own."""
    settings = with_settings(read_scene("four-bar-motor"), ["solve.duration=0.05 s"])
    in_c = simulate(load(settings))
    monkeypatch.setattr(engine, "_kernels_in_c", lambda kernels: [])
    by_numba = simulate(load(settings))
    assert engine.library(Kind.PLAIN).in_c
    for name, series in by_numba.series.items():
        np.testing.assert_allclose(in_c.series[name].values, series.values, rtol=1e-9, atol=1e-9, err_msg=name)


def test_kernels_of_other_modules_have_other_libraries(compiler, cache):
    """Two structures share the kernels of generated.laws."""
    laws = [load(read_scene(name)).coupled.engine.kernels for name in ("four-bar-motor", "slider-crank-150-coupled")]
    for kernels in laws:
        assert len(engine.kernel_addresses(kernels, in_c=True)) == 2
    assert len([*cache.iterdir()]) == len({tuple(each.py_func.__code__.co_filename for each in of) for of in laws})


def test_without_a_compiler_there_is_no_library(cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert addresses() == []
    assert [*cache.iterdir()] == []


def test_a_compiler_that_fails_is_named(cache, monkeypatch, caplog):
    monkeypatch.setenv("CC", "false")
    assert addresses() == []
    assert "; numba compiles it, which takes longer" in caplog.text and "can't build prescribed-" in caplog.text


def test_a_library_is_kept_and_replaces_older_and_damaged_ones(compiler, cache, monkeypatch):
    assert len(addresses()) == len(entries.PRESCRIBED)
    (file,) = cache.iterdir()
    monkeypatch.setenv("CC", "no-such-compiler")
    assert addresses()  # without the compiler
    monkeypatch.delenv("CC")
    monkeypatch.setattr(c_library, "_FLAGS", ("-O0", "-g"))
    assert addresses()
    assert [*cache.iterdir()] != [file]
    (newer,) = cache.iterdir()
    newer.unlink()  # not written over: it is in use
    newer.write_bytes(b"damaged")
    assert len(addresses()) == len(entries.PRESCRIBED)


def test_a_library_of_the_installation_is_used_before_the_cache(compiler, cache, monkeypatch, tmp_path_factory):
    assert addresses()
    (file,) = cache.iterdir()
    package = tmp_path_factory.mktemp("package")
    (package / "support").mkdir()
    file.rename(package / "support" / file.name)
    monkeypatch.setattr(c_library, "PACKAGE", package)
    monkeypatch.setenv("CC", "no-such-compiler")
    assert len(addresses()) == len(entries.PRESCRIBED)
    assert [*cache.iterdir()] == []
