# Two targets matter: `make demo` and `make test`. Both set up .venv first, with the versions of constraints.txt.

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

PYTHON ?= $(shell command -v python3.11 || command -v python3)
WORKERS ?= 2
VENV := .venv
RUN := $(VENV)/bin
INSTALLED := $(VENV)/.evergym-installed
STAMP := $(VENV)/.evergym-setup
# Progress bars for people, silence for logs. Byte code is made for what is imported: for all, it took half of the time.
PIP := $(RUN)/python -m pip install --disable-pip-version-check --no-compile $(if $(MAKE_TERMOUT),,--quiet)
TORCH := $(shell grep -E '^torch==' constraints.txt)

.PHONY: help setup test lint demo play docs clean

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "make %-8s %s\n", $$1, $$2}'

setup: $(STAMP)  ## create .venv with pinned versions (once; again when pyproject.toml or constraints.txt change)

$(INSTALLED): pyproject.toml constraints.txt
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "evergym needs Python 3.11 or later; $(PYTHON) is older. Name another: make setup PYTHON=/path/to/python3.11" >&2; exit 1; }
	@test -x $(RUN)/python || { echo "Creating $(VENV)"; "$(PYTHON)" -m venv $(VENV); }
	@echo "Installing $(TORCH) (the largest download), then the rest"
	@$(PIP) "$(TORCH)"
	@$(PIP) -c constraints.txt setuptools wheel
	@$(PIP) -c constraints.txt --no-build-isolation -e '.[dev]'
	@touch $@

$(STAMP): $(INSTALLED)
	@$(RUN)/python -m evergym.agents.precompile
	@touch $@

lint: $(INSTALLED)  ## ruff and mypy
	@$(RUN)/ruff check .
	@$(RUN)/ruff format --check .
	@$(RUN)/mypy

# Kernels compile on one core, so lint and types are checked on another.
test: $(INSTALLED)  ## lint, types and all tests; ends with pytest's closing line
	@$(MAKE) --no-print-directory -j2 lint setup
	@$(RUN)/python -m pytest -n $(WORKERS) --dist worksteal

demo: $(STAMP)  ## train, evaluate against the duty cycle, write a report (QUICK=1: a few minutes)
	@$(RUN)/python -m evergym.agents.demo $(if $(filter-out 0,$(QUICK)),--quick)

play: $(STAMP)  ## drive the robot by hand in the browser (ARGS="--env MammobotPegs-v0": other options)
	@$(RUN)/evergym play $(ARGS)

docs: $(STAMP)  ## build the documentation into build/site (SERVE=1: and serve it on 127.0.0.1:8000, anew on every change)
	@NO_MKDOCS_2_WARNING=1 $(RUN)/mkdocs $(if $(filter-out 0,$(SERVE)),serve --dev-addr 127.0.0.1:8000,build)

clean:  ## remove what tests and builds leave behind (keeps .venv and runs)
	@rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
