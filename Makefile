# The only place where commands are spelled; `make` alone lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PYTEST := $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-slow check bench clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

setup: $(STAMP) ## make .venv with the project (editable) and all its extras

$(STAMP): pyproject.toml constraints.txt
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || ./.ci/make-venv "$(PYTHON)" "$(VENV)"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[all]"
	@touch $@

demo: setup ## sample the posterior of a small office and leave pictures in demo/
	$(BIN)/prf sample --laser data/demo-office.log.gz --time-budget 60 --seed 1 -o demo/office --force
	@echo "pictures:" demo/office/*.png

test: setup ## all tests but the slow ones
	$(BIN)/python -m tests.warm_kernels
	$(PYTEST) -n 2 -m "not slow"

test-slow: setup ## the slow tests: long chains, statistics with many draws
	$(PYTEST) -n 2 -m slow

check: setup ## lint, format, types, import contracts, spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell

bench: setup ## steps per second of the sampler beside its slow twins, in one run
	$(BIN)/python -m benchmarks.step_rate

clean: ## remove .venv, what the demo made, and caches
	rm -rf $(VENV) demo .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks .coverage build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
