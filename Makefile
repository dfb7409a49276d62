# The only place where commands are spelled; `make` alone lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.installed
STAMP := $(VENV)/.installed-all
DOCS_STAMP := $(VENV)/.installed-docs
PYTEST := $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-slow test-oldest verify check coverage package test-package docs figures bench bench-all model clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

setup: $(STAMP) ## make .venv with the project (editable), its extras and the developers' tools

$(CORE): pyproject.toml constraints.txt
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || ./.ci/make-venv "$(PYTHON)" "$(VENV)"
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(STAMP): $(CORE)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e ".[all,dev]"
	@touch $@

# The town is assessed while the kernels of the rooms are compiled, which takes one core.
demo: $(CORE) ## map four rooms until the chains agree, assess a town; leaves a page of each in demo/
	@mkdir -p demo
	@$(BIN)/mapq classify data/demo-town.ply.gz -o demo/town.ply --tolerance 0.1 --force >demo/town.txt 2>&1 & town=$$!; \
	echo "$(BIN)/prf sample --laser data/demo-rooms.log.gz --seed 1 -o demo/rooms --force"; \
	$(BIN)/prf sample --laser data/demo-rooms.log.gz --seed 1 -o demo/rooms --force || { kill $$town; exit 1; }; \
	$(BIN)/prf report demo/rooms --force || { kill $$town; exit 1; }; \
	wait $$town; status=$$?; \
	echo "$(BIN)/mapq classify data/demo-town.ply.gz -o demo/town.ply --tolerance 0.1 --force"; \
	cat demo/town.txt; exit $$status
	$(BIN)/mapq report demo/town.ply -o demo/town.html --force
	@echo "open demo/rooms.html and demo/town.html in a browser; with data of your own:"
	@echo "  $(BIN)/prf info YOUR_FILES       says what they are, and the command that maps them"
	@echo "  $(BIN)/mapq classify YOUR_CLOUD  judges a map; better: YOUR_SCANS --poses YOUR_POSES"

test: setup ## all tests but the slow ones
	@echo "compiling what the tests call, once; some minutes in a fresh checkout"
	@$(BIN)/python -m tests.warm_kernels > /dev/null
	NUMBA_DISABLE_JIT=1 $(PYTEST) -n 2 --dist loadfile -m "uncompiled and not slow" tests/kernels
	$(PYTEST) -n 2 -m "not uncompiled and not slow" --ignore tests/test_house.py

test-slow: $(DOCS_STAMP) ## the slow tests: long chains, statistics with many draws
	$(PYTEST) -n 2 -m "uncompiled or slow"

test-oldest: ## all tests but the slow ones, with the oldest versions allowed of everything, in .venv-oldest
	./.ci/make-venv "$(PYTHON)" .venv-oldest
	.venv-oldest/bin/python -m pip install --quiet --no-compile --disable-pip-version-check -c tests/packaging/minimum.txt -e ".[all,dev]"
	.venv-oldest/bin/python -m tests.warm_kernels
	.venv-oldest/bin/python -m pytest -n 2 -m "not uncompiled and not slow"

verify: setup ## show that the sampler is right: calibration, joint law, a second sampler; half an hour, plots in verify/
	$(BIN)/python -m tests.statistical --output verify

check: setup ## lint, format, types, import contracts, sizes, spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(PYTEST) -q tests/test_house.py
	$(BIN)/codespell

coverage: setup ## lines and branches that the tests run, kernels uncompiled; fails below 95 %; half an hour
	rm -rf build/coverage
	$(BIN)/python -m tests.warm_kernels
	$(BIN)/coverage run -m pytest -n 2 -m "not uncompiled and not slow"
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest -n 2 -m "not slow" @tests/uncompiled.txt
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

package: setup ## build wheel and source archive of the last commit in dist/, install and call the wheel alone; two minutes
	$(BIN)/python -m tests.packaging build

test-package: setup ## the main jobs with the wheel alone, newest and oldest versions, and the container's; a quarter of an hour
	$(BIN)/python -m tests.packaging jobs

$(DOCS_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check -c constraints.txt -e ".[docs]"
	@touch $@

docs: $(DOCS_STAMP) ## write docs/reference from the command lines, and the site in build/site, with tutorials as notebooks
	$(BIN)/python -m docs.make_reference
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m docs.make_site

figures: setup ## make the pictures of README and tutorials anew; a quarter of an hour
	$(BIN)/python -m docs.make_figures

bench: setup ## speed and quality beside references in the same run; some ten minutes
	$(BIN)/python -m benchmarks.step_rate
	$(BIN)/python -m benchmarks.segmentation
	$(BIN)/python -m benchmarks.graph_cut
	$(BIN)/python -m benchmarks.table2

bench-all: setup ## all figures of benchmarks/README.md, dated, in build/bench; most of a day, in parts: it goes on where it was
	$(BIN)/python -m benchmarks.everything

model: setup ## train the model that ships with mapq anew, on simulated maps
	$(BIN)/python -m data.make_default_model

clean: ## remove .venv, what the demo made, and caches
	rm -rf $(VENV) .venv-oldest demo verify .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis .benchmarks .coverage build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
