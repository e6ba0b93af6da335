# `make` alone lists the targets.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup run test derive check-derived lint clean

PYTHON ?= python3
BUILD := .build
BIN := $(BUILD)/venv/bin
READY := $(BUILD)/venv/ready

# One thread a process: the tests already run one process a core.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export NUMBA_NUM_THREADS := 1
export NUMBA_CACHE_DIR := $(CURDIR)/$(BUILD)/numba

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY)  ## make the virtual environment in .build/venv, once

$(READY): pyproject.toml
	$(PYTHON) -m venv $(BUILD)/venv
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

run: $(READY)  ## run the reference engine into .build/engine
	$(BIN)/kaneflex run engine --output $(BUILD)/engine --force
	@echo "Results, summary and pictures: $(BUILD)/engine"

test: $(READY)  ## run the tests
	$(BIN)/pytest -n 2

derive: $(READY)  ## derive the modules of generated/ that are missing or out of date
	$(BIN)/python -m kaneflex.derive

lint: $(READY)  ## check the style
	$(BIN)/ruff check .

clean:  ## remove everything that was built
	rm -rf $(BUILD) build dist kaneflex.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
