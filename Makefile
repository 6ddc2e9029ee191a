# Python and make are all you need: every target makes .venv and installs into it first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
ARGS ?=

.DEFAULT_GOAL := help
.PHONY: help paper test test-slow check format lint types contracts docs clean

help:  ## List the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

paper: $(READY)  ## Run the paper's experiment into results/paper (more arguments: ARGS="--trials 20")
	$(BIN)/deqmcl paper $(ARGS)

test: $(READY)  ## Run the tests, without those of minutes
	$(BIN)/python -m pytest -m "not slow" -n auto $(ARGS)

test-slow: $(READY)  ## Run the statistical tests of minutes
	$(BIN)/python -m pytest -m slow $(ARGS)

check: format lint types contracts test docs  ## All that CI checks

format: $(READY)  ## Check the formatting (mend it: .venv/bin/ruff format)
	$(BIN)/ruff format --check

lint: $(READY)  ## Lint; no text may name a folder of one machine or a package registry
	$(BIN)/ruff check
	@! git grep -nE '(^|[^[:alnum:].~_-])/([w]ork|[r]oot|[h]ome|[U]sers)/[[:alnum:]]|[p]ypi\.org|[p]ythonhosted\.org|[n]pmjs\.'

types: $(READY)  ## Check the types
	$(BIN)/mypy

contracts: $(READY)  ## Check who may import whom
	$(BIN)/lint-imports

docs: $(READY)  ## Run the code of README and docs
	$(BIN)/python -m pytest --markdown-docs -m markdown-docs README.md docs

$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed, this is " + sys.version.split()[0] + ": give one by make PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

clean:  ## Remove what the targets made, results excepted
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
