"""Library of the engine by the C compiler: the same runs as with numba, and numba where there is no compiler."""

import numpy as np
import pytest

from kaneflex import load, read_scene, simulate, with_settings
from kaneflex.multibody.compile import c_library, entries
from kaneflex.multibody.compile.c_library import c_addresses
from kaneflex.multibody.model.layout import Kind


def addresses():
    return c_addresses("prescribed", Kind.RIGID_SPACE, entries.PRESCRIBED, entries.sources())


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache folder of its own, for libraries that are compiled in a moment."""
    monkeypatch.setattr(c_library, "_FLAGS", ("-O0",))
    monkeypatch.setattr(c_library, "ensure_cache_folder", lambda: tmp_path)
    return tmp_path


SCENES = {
    "four-bar-motor": (), "slider-crank-clearance": ("solve.duration=2 ms",), "bricard": ("solve.duration=0.1 s",),
}  # fmt: skip


@pytest.mark.exhaustive  # numba compiles the engine of each kind for 15 s
@pytest.mark.parametrize("scene", SCENES)
def test_runs_are_those_of_numba(compiler, scene, monkeypatch):
    settings = with_settings(read_scene(scene), SCENES[scene])
    in_c = simulate(load(settings))
    monkeypatch.setattr(entries, "c_addresses", lambda *of: [])
    entries.library.cache_clear()
    by_numba = simulate(load(settings))
    entries.library.cache_clear()
    for name, series in by_numba.series.items():
        most = 1e-9 * np.abs(series.values).max()
        np.testing.assert_allclose(in_c.series[name].values, series.values, rtol=0.0, atol=most, err_msg=name)


def test_without_a_compiler_there_is_no_library(cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert addresses() == []
    assert [*cache.iterdir()] == []


def test_a_compiler_that_fails_is_named(cache, monkeypatch, caplog):
    monkeypatch.setenv("CC", "false")
    assert addresses() == []
    assert "can't build the engine; numba compiles it" in caplog.text


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
