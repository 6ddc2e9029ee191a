# Python and make are all you need: every target makes .venv and installs into it first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
ARGS ?=
LOWEST := tests/deqmcl_gym_env/test_clients.py tests/maps/test_grid_files.py tests/logs/test_round_trips.py \
	tests/benchmarks_harness/test_pictures.py tests/benchmarks_harness/test_mcap.py tests/system/test_stopped_sweeps.py
unexport PYTHONDONTWRITEBYTECODE  # the tests start some hundred processes: compile once

.DEFAULT_GOAL := help
.PHONY: help setup paper test test-slow lowest check format lint types contracts docs tables reports stale site release clean

help:  ## List the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

setup: $(READY)  ## Make .venv and install into it

paper: $(READY)  ## Run the paper's experiment into results/paper (more arguments: ARGS="--trials 20")
	$(BIN)/deqmcl paper $(ARGS)

test: $(READY)  ## Run the tests, without those of minutes and of the documents
	$(BIN)/python -m pytest -m "not slow" -n auto --durations=25 --ignore=tests/docs $(ARGS)

test-slow: $(READY)  ## Run the tests of minutes: statistics, random faults
	$(BIN)/python -m pytest -m slow -n auto $(ARGS)

lowest: $(READY)  ## Run some tests with the lowest versions that pyproject.toml allows
	$(BIN)/uv venv --quiet --clear --python $(BIN)/python build/lowest
	$(BIN)/uv pip install --quiet --python build/lowest --resolution lowest-direct '.[completion,dask,report,ros,test,view]'
	build/lowest/bin/deqmcl paper --trials 1 --out "$$(mktemp -d)/paper"
	build/lowest/bin/python -m pytest -n auto $(LOWEST)

check: format lint types contracts test docs stale site release  ## All that CI checks

format: $(READY)  ## Check the formatting (mend it: .venv/bin/ruff format)
	$(BIN)/ruff format --check

lint: $(READY)  ## Lint; no text may name a folder of one machine or a package registry
	$(BIN)/ruff check
	@! git grep -nE '(^|[^[:alnum:].~_-])/([w]ork|[r]oot|[h]ome|[U]sers)/[[:alnum:]]|[p]ypi\.org|[p]ythonhosted\.org|[n]pmjs\.'

types: $(READY)  ## Check the types
	$(BIN)/mypy

contracts: $(READY)  ## Check who may import whom
	$(BIN)/lint-imports

docs: $(READY)  ## Run the code and the commands of README and docs
	$(BIN)/python -m pytest --markdown-docs -m markdown-docs --ignore=docs/gallery README.md docs
	$(BIN)/python -m pytest -m "not slow" -n auto tests/docs

tables: $(READY)  ## Write the tables of README and docs from the reports and the code
	$(BIN)/python -m docs.tables

reports: $(READY)  ## Run the samples of all reports again, or whole reports: ARGS="NAME ..."
	$(BIN)/python -m docs.report_runs $(ARGS)

stale: $(READY)  ## Check that tables and reports have the numbers of this code
	$(BIN)/python -m docs.tables --check
	$(BIN)/python -m docs.report_runs --check

site: $(READY)  ## Build the site into build/site; it runs the scripts of the gallery
	$(BIN)/sphinx-build -q -W --keep-going -c docs/site . build/site
	cp build/site/README.html build/site/index.html

release: $(READY)  ## Build wheel and sdist into dist, and use the wheel in a fresh environment
	rm -rf dist
	$(BIN)/python -m build --outdir dist . >/dev/null
	$(BIN)/python -m venv build/fresh --clear
	build/fresh/bin/python -m pip install --quiet --disable-pip-version-check "$$(echo dist/*.whl)[report]"
	cd "$$(mktemp -d)" && export PATH="$(CURDIR)/build/fresh/bin:$$PATH" && deqmcl --version \
		&& deqmcl paper --trials 2 --out paper && deqmcl sweep quick --out quick \
		&& deqmcl check mcl-plan && rm -r "$$PWD"

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, this is " + sys.version.split()[0] + ": give one by make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:  ## Remove what the targets made, results excepted
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
