# `make` alone lists the targets.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup run test extremes derive check-derived bench bench-quick bench-derive bench-choice docs wheel lint clean

PYTHON ?= python3
# EXTRAS=test,peer,docs,bench installs more beside what the tests need; without it the tests of it skip and
# say so, and the benchmarks name what is missing. What only runs scenes installs none of it.
EXTRAS ?= test
BUILD := .build
BIN := $(BUILD)/venv/bin
READY := $(BUILD)/venv/ready
READY_TEST := $(BUILD)/venv/ready-test
TYPED := $(BUILD)/venv/typed
DERIVED := $(BUILD)/derived

# Kernels are compiled once for all targets, and the checkout stays clean.
export NUMBA_CACHE_DIR := $(CURDIR)/$(BUILD)/numba

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY_TEST)  ## make the virtual environment in .build/venv, once, with what EXTRAS names; run needs less

# Python compiles what is imported, a sixth of what is installed.
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile --editable

$(READY): pyproject.toml
	$(PYTHON) -m venv $(BUILD)/venv
	$(INSTALL) .
	@touch $@

# The editable install finds its packages by an import hook, which type checkers do not follow: they read this path.
$(TYPED): $(READY)
	@echo "$(CURDIR)/src" > "$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/kaneflex-types.pth"
	@touch $@

$(READY_TEST): $(READY) tests/peers/pyproject.toml | $(TYPED)
	$(INSTALL) '.[$(EXTRAS)]' --editable tests/peers
	@touch $@

run: $(READY)  ## run the reference engine; results, summary and pictures in .build/engine
	$(BIN)/kaneflex run engine -o $(BUILD)/engine --force
	@echo "Results, summary and pictures are in $(BUILD)/engine"

# What compiles for long, in two halves that have least in common: the engines of coupled motion with friction, with
# rigid and elastic contacts and without either; motions in space and elements there, without and with bodies that
# deform, with loads that jump, and the loops of linear equations.
SLOW_PLANAR := stick-slip bouncing-bar,contacts.stop.contact.law=newton,contacts.stop.contact.materials=none \
	bouncing-bar elastic-double-pendulum CONTACT_SPACE
SLOW_SPATIAL := spinning-top spatial-slider-crank-elastic spatial-slider-crank-elastic,solve.preset=coupled \
	rotating-blade,solve.preset=coupled,solve.start=zero,solve.duration=0.01,loads.push.value=none,loads.push.law=step(t) \
	engine FRICTION_SPACE

# One thread a process, since the tests run one process a core. The kernels are compiled before these start, each once:
# two that fill numba's cache at the same time would both compile them, and can overwrite each other's entries. Each
# takes half the files and then from the other's rest: tests of one file share what they ran.
test: export OMP_NUM_THREADS := 1
test: export OPENBLAS_NUM_THREADS := 1
test: export NUMBA_NUM_THREADS := 1
# Bytecode is kept, whatever the environment says: pytest takes ten seconds a process to rewrite all assertions.
test: export PYTHONDONTWRITEBYTECODE :=
test: $(READY_TEST)  ## run the tests
	@echo "compiling the kernels ..."
	@printf '%s\n' "$(SLOW_PLANAR)" "$(SLOW_SPATIAL)" | xargs -P 2 -L 1 $(BIN)/python tests/compile_kernels.py
	@date +%s > $(BUILD)/test-began
	$(BIN)/pytest -n 2 --dist worksteal
	@expr $$(date +%s) - $$(cat $(BUILD)/test-began) > $(BUILD)/test-seconds

extremes: export OMP_NUM_THREADS := 1
extremes: export OPENBLAS_NUM_THREADS := 1
extremes: export NUMBA_NUM_THREADS := 1
extremes: $(READY_TEST)  ## run the extremes suite in full into docs/extremes.md; read 20,000 mutated scenes, run 2,000, import 500 meshes; every case of the tests marked exhaustive
	$(BIN)/python tests/bench_extremes.py
	$(BIN)/python tests/scene_fuzz.py 20000
	$(BIN)/python tests/scene_fuzz.py --runs 2000
	$(BIN)/python tests/import_fuzz.py 500
	$(BIN)/pytest -n 2 -m exhaustive --exhaustive

derive: $(READY)  ## derive the modules in generated/ anew
	$(BIN)/python -m kaneflex.derive

check-derived: $(READY)  ## show that generated/ is what the scenes derive to, byte for byte
	rm -rf $(DERIVED)
	mkdir -p $(DERIVED)
	$(BIN)/python -m kaneflex.derive -o $(DERIVED)
	diff --recursive --exclude=__pycache__ generated $(DERIVED)

# One thread, as the tests; the sweeps take a process for each core.
bench bench-quick: export OMP_NUM_THREADS := 1
bench bench-quick: export OPENBLAS_NUM_THREADS := 1
bench bench-quick: export NUMBA_NUM_THREADS := 1
bench bench-quick: export PYTHONPATH := tests
bench: $(READY_TEST)  ## time all against C and other programs into docs/benchmarks.md; SECTIONS="kernels ..." some of it
	$(BIN)/python -m bench $(SECTIONS)

bench-quick: $(READY_TEST)  ## check that the kernels are about as fast as hand-written C
	$(BIN)/python -m bench --quick

bench-derive: $(READY_TEST)  ## time deriving and compiling of chains of links into docs/derive-times.md
	$(BIN)/python tests/bench_derive.py

bench-choice: $(READY_TEST)  ## compare choices by tolerance with brute force; CASES="engine ..." of some
	$(BIN)/python tests/bench_choice.py $(CASES)

docs: $(READY)  ## build the site of docs/ into .build/site, its notebook run, its links checked
	$(BIN)/python -c "import myst_nb" 2> /dev/null || $(INSTALL) '.[docs]'
	$(BIN)/sphinx-build --fail-on-warning --keep-going -q -b html -d $(BUILD)/site-made docs $(BUILD)/site
	@echo "The site is in $(BUILD)/site/index.html"

wheel: $(READY)  ## build a wheel whose kernels come compiled for this platform into .build/dist; SCENES="engine ..." of some
	$(BIN)/python -c "import build, wheel" 2> /dev/null || $(INSTALL) '.[package]'
	rm -rf build $(BUILD)/dist
	$(BIN)/python -m build --no-isolation --outdir $(BUILD)/dist .
	$(BIN)/python .ci/ship_kernels.py $(BUILD)/dist/*.whl $(SCENES)

lint: $(READY_TEST)  ## check the style of the sources; their types and prose against baselines that only fall
	$(BIN)/ruff check .
	$(BIN)/python tests/check_prose.py
	$(BIN)/python tests/check_types.py

clean:  ## remove everything that was built
	rm -rf $(BUILD) build dist kaneflex.egg-info .pytest_cache .ruff_cache .hypothesis
	find derive generated src tests -name __pycache__ -type d -prune -exec rm -rf {} +
