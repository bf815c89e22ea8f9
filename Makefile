# Every target sets up what it needs in .venv first; nothing else has to be installed than python3 >= 3.11.
SHELL := /bin/bash
unexport PYTHONDONTWRITEBYTECODE # without bytecode each process of a node or a test compiles all sources again
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN := $(BIN)/python -m
LAB_ARGS ?= --nodes 16
REPORT ?= report
SITE ?= share/doc/site
# tests with whole vehicles, which fly in real time; in this order, so that short ones are the last
LABS := $(patsubst %,tests/integration/%,cli documentation lab swarm)

# tests that compute wait now and then for a process: with one worker more than cores, unit tests take a tenth less
WORKERS := $(shell expr $$(nproc) + 1)

# packages of decisions, whose coverage is measured
CORES = $(shell find lib daemons cli -type d -name core | sort)
comma := ,
space := $(subst ,, )

.PHONY: lab test coverage simulations kills lint check quick hooks bench bench-links figures docs site dist boot-test clean

lab: $(VENV)/.lab ## 16 nodes fly a formation; prints the table, writes $(REPORT)/
	$(BIN)/swarmctl lab run formation $(LAB_ARGS) --out $(REPORT)

test: $(VENV)/.test ## all tests; those that compute one per core and one more, those that wait seven at a time, labs four at a time
	$(RUN) pytest -q -n $(WORKERS) --dist worksteal tests/simulation tests/architecture tests/unit
	$(RUN) pytest -q -n 7 --dist loadfile $(LABS:%=--ignore=%) tests/integration
	$(RUN) pytest -q -n 4 --dist loadfile --no-loadscope-reorder $(LABS)

coverage: $(VENV)/.test ## branch coverage of all cores by unit tests and simulations; less than 95 % is an error
	@rm -rf .coverage
	$(BIN)/coverage run --source=$(subst $(space),$(comma),$(CORES)) -m pytest -q -n auto --dist worksteal tests/simulation tests/unit
	$(BIN)/coverage combine -q
	$(BIN)/coverage report

simulations: $(VENV)/.test ## simulations with all their seeds, properties with all their examples; test runs a part
	SWARM_SEEDS=all $(RUN) pytest -q -n auto --dist worksteal tests/simulation tests/unit

kills: $(VENV)/.test ## kills each daemon again and again, with one process for each and one for all; test does ten
	$(RUN) tests.integration.guard.steady_kills --count 100

lint: $(VENV)/.test ## style, types, layering
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy lib daemons cli tests share/swarm/examples share/doc/generate.py
	$(BIN)/lint-imports --no-cache

check: $(VENV)/.test ## the fast part: lint, unit and architecture tests; types are checked on one core, beside the tests
	@$(MAKE) --no-print-directory -j2 lint quick

quick: $(VENV)/.test # the tests of check alone
	$(RUN) pytest -q -n $(WORKERS) --dist worksteal tests/architecture tests/unit

hooks: $(VENV)/.test ## git runs the quick checks before each commit (.pre-commit-config.yaml)
	$(BIN)/pre-commit install

bench: $(VENV)/.bench ## measures; ratios in one run
	for file in $(filter-out $(addprefix tests/bench/,lab.py links.py rows.py), $(wildcard tests/bench/*.py)); do echo "== $$file"; $(BIN)/python "$$file" || exit 1; done

bench-links: $(VENV)/.test ## measures the links and writes the table share/doc/links.md (root, for network namespaces)
	$(BIN)/python tests/bench/links.py --write

figures: $(VENV)/.test ## runs the experiment on this machine and takes its figures into the README
	$(BIN)/swarmctl lab run formation $(LAB_ARGS) --out $(REPORT)
	$(BIN)/python share/doc/generate.py $(REPORT)

docs: $(VENV)/.docs ## writes the generated part of share/doc, and the site share/doc/site from it
	$(BIN)/python share/doc/generate.py
	@$(MAKE) --no-print-directory site

site: $(VENV)/.docs # the site alone; a warning is an error
	@rm -rf $(SITE)
	$(BIN)/sphinx-build --quiet --fail-on-warning --jobs auto share/doc $(SITE)
	@rm -r $(SITE)/.doctrees $(SITE)/.buildinfo
	@echo "$(SITE)/index.html: swarmctl docs opens it"

dist: site ## dist/: wheel (with the site), sources and their SHA-256 sums
	@rm -rf dist
	$(RUN) hatchling build --directory dist --target sdist --target wheel
	@cd dist && sha256sum swarmware-* >SHA256SUMS && cat SHA256SUMS

boot-test: $(VENV)/.test ## boots a systemd (root, systemd-container, debootstrap) and follows share/doc/operations.md
	SWARM_BOOT_TEST=1 $(RUN) pytest -q tests/boot

clean:
	rm -rf $(VENV) report dist build share/doc/site .mypy_cache .ruff_cache .hypothesis .coverage

# Debian's python3 comes without ensurepip unless python3-venv is there: say so instead of failing in a trace.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "swarmware needs python3 >= 3.11; set PYTHON="; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "python3 has no venv module: install python3-venv (apt-get install python3-venv)"; exit 1; }
	@echo "making $(VENV)"
	$(PYTHON) -m venv $(VENV)

$(VENV)/.lab: pyproject.toml | $(VENV)/bin/python
	@echo "installing swarmware and what the lab needs into $(VENV)"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[lab]'
	@touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/bin/python
	@echo "installing swarmware and its test tools into $(VENV)"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@ $(VENV)/.lab $(VENV)/.docs

$(VENV)/.docs: pyproject.toml | $(VENV)/bin/python
	@echo "installing swarmware and what builds its documentation and distribution into $(VENV)"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[docs]' 'hatchling>=1.27'
	@touch $@

$(VENV)/.bench: $(VENV)/.test
	@echo "installing the peers to measure against into $(VENV)"
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev,bench]'
	@touch $@
