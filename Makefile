# One door for tools. `make reproduce` and `make test` work in a fresh clone on a machine with Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PACKAGE := $(VENV)/.package
# Bytecode is written at the first import: that of all that is installed takes a minute.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# uv installs in a quarter of pip's time. It does not read pip's settings: where it finds no index, pip installs.
UV := $(BIN)/uv pip install --quiet --system-certs --python $(BIN)/python
INSTALL := sh -c '$(UV) --editable "$$0" || $(PIP) --editable "$$0"'
PAPER := gallery effect_of_D effect_of_m morphology
SEAL := seal seal_map seal_region metal_seal metal_seal_elastic
# Second readings of the paper's ambiguous passages, and more surfaces than it has: for the claims report.
READINGS := ten_seeds_of_m many_seeds morphology_of_D full_contact first_contact in_plane_scaling \
            reading_variance_law reading_variance_law_D reading_summit_plane
# Numbers of the literature. A study whose file is not on this machine is left out, and its row says so.
LITERATURE := wave_love wave_fourier wave_punch two_codes area load closing stiffness \
              mirco_sup2 mirco_supN6 mirco_sup5 mirco_sup7 challenge

# Bytecode is written: else every process of the tests, and every run of them, compiles the package and the tests anew.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := setup
.PHONY: help setup reproduce claims seal literature test bench bench-peers validation windows tradeoff intervals extremes pages publish-check reference public crossing docs coverage test-slow lint smoke lowest clean

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-13s %s\n", $$1, $$2}' $(firstword $(MAKEFILE_LIST))

setup: $(STAMP)  ## install the package and all tools into .venv

$(BIN)/python:
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) uv || true

$(PACKAGE): pyproject.toml | $(BIN)/python
	@$(INSTALL) .
	@touch $@

$(STAMP): pyproject.toml | $(BIN)/python
	@$(INSTALL) '.[dev]'
	@touch $(PACKAGE) $@

# It needs the package alone: no tests, no tools. Two studies run at a time, the longest from the start, each in the
# processes of half of the cores: a process that starts takes a second.
SHARE = $(shell $(BIN)/python -c 'import os; print(max(1, (os.cpu_count() or 1) // 2))')
reproduce: $(PACKAGE)  ## run the paper's studies, draw its figures and the report of claims
	@echo "two studies at a time; each prints its progress and its numbers when it ends"
	@$(MAKE) --no-print-directory --jobs 2 --output-sync run-many_seeds $(PAPER:%=run-%) $(READINGS:%=run-%)
	@$(MAKE) --no-print-directory --jobs 2 claims $(PAPER:%=plot-%)

claims:  ## report on the claims, from the runs of make reproduce
	@$(BIN)/roughvol report $(PAPER) $(READINGS) --out runs/report --check tests/regression/expected_paper.json

seal: $(PACKAGE)  ## run the sealing studies and report on them
	@for study in $(SEAL); do $(BIN)/roughvol run configs/$$study.yaml || exit $$?; done
	@$(MAKE) --no-print-directory --jobs 2 $(SEAL:%=plot-%)
	@$(BIN)/roughvol report $(SEAL) --out runs/seal_report

run-%:
	@$(BIN)/roughvol run configs/$*.yaml --jobs $(SHARE)

# They have cases in common.
run-effect_of_m: run-effect_of_D
run-ten_seeds_of_m: run-effect_of_m
run-reading_variance_law_D: run-reading_variance_law

plot-%:
	@$(BIN)/roughvol plot runs/$*

literature: setup  ## run the studies of the literature and report on its numbers
	@$(BIN)/python -m tests.bench.framework_surface
	@cd configs/literature && for name in $(LITERATURE); do \
	  file=$$(sed -n 's/^surface: {file: \([^,}]*\).*/\1/p' literature_$$name.yaml); \
	  if [ -n "$$file" ] && [ ! -e "$$file" ]; then echo "literature_$$name: no configs/literature/$$file, left out"; continue; fi; \
	  (cd ../.. && $(BIN)/roughvol run configs/literature/literature_$$name.yaml) || exit $$?; done
	@$(BIN)/roughvol report runs/literature_*/study.nc --out runs/literature

# worksteal: each of the two takes half of the files in order, so that few fixtures are made twice.
test: setup  ## run the tests
	@$(BIN)/python -m pytest -n 2 --dist worksteal

bench: setup  ## compare the solver's counts with tests/bench/baseline.json; print seconds
	@$(BIN)/python -m tests.bench.solver --m 4 5 6 7 8 9 10 --rtol 1e-3 1e-6 --compare
	@$(BIN)/python -m tests.bench.solver --kernel love fourier --m 6 8 --rtol 1e-6 --compare --out runs/bench/periodic

# One of these codes is AGPL. They are installed here and imported nowhere else. m = 8 takes more than a quarter of an hour.
bench-peers: setup  ## compare with other contact codes, installed for this
	@$(INSTALL) '.[dev,peers]'
	@$(BIN)/python -m tests.bench.peers --m 6 7
	@$(BIN)/python -m tests.bench.peers --periodic --m 7

validation: setup  ## print errors against closed forms, by resolution
	@$(BIN)/python -m tests.bench.validation

windows: setup  ## leaks of windows of a known joint: free, interior, mirrored
	@$(BIN)/python -m tests.bench.windows --windows 9
	@$(BIN)/python -m tests.bench.windows --hurst 0.5 --rolloff 8 --joints 4 --windows 4 --areas 0.05 0.15 0.3

tradeoff: setup  ## measure speed against accuracy, to docs/explanation/notes/tradeoff.md
	@$(BIN)/roughvol tradeoff configs/tradeoff.yaml
	@$(BIN)/python -m tests.bench.asked

# Minutes of one core each; solved numbers are kept in /tmp/roughvol_coverage.
intervals: setup  ## measure how often the intervals of a leak card hold
	@$(BIN)/python -m tests.bench.card_coverage
	@$(BIN)/python -m tests.bench.window_coverage

extremes: setup  ## press the extremes of every input, to docs/explanation/notes/extremes.md
	@$(BIN)/python -m tests.extremes

# Hours of one core if all are old. COMMANDS='"make bench"' runs one of them.
pages: setup  ## run the commands of measured tables of an older minor version, and put their tables in place
	@$(BIN)/python -m tests.bench.tables $(COMMANDS)

# Interpreters of this machine, as paths or names: make publish-check PYTHONS="python3.11 python3.13"
PYTHONS ?= $(PYTHON)
publish-check: setup  ## build and check sdist and wheel; install and run them with the lowest and the newest libraries
	@$(BIN)/python -m tests.publish --python $(PYTHONS) --page

reference: setup  ## write docs/reference/keys-and-variables.md: all keys of a study and all stored variables
	@$(BIN)/python docs/keys_and_variables.py

public: setup  ## write tests/public_names.toml: every public name
	@$(BIN)/python -m tests.public_names

crossing: setup  ## write docs/reference/crossing.md: what may be combined, as the tests check it
	@$(BIN)/python -m tests.crossing

# Warnings are errors. Notebooks are executed. Nothing is fetched: the site works without the internet.
docs: setup  ## build the documentation site, to build/site/index.html
	@$(BIN)/python -m sphinx --quiet -b html -W --keep-going -d build/doctrees docs build/site
	@echo build/site/index.html

coverage: setup  ## run the tests with branch coverage, HTML in runs/coverage
	@$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report term:skip-covered --cov-report html

test-slow: setup  ## run the tests that take minutes
	@$(BIN)/python -m pytest -m slow

lint: setup  ## check style, types and docstrings
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/numpydoc lint $$(find roughvol -name '*.py')

smoke: $(PACKAGE)  ## run and plot one small study
	@$(BIN)/roughvol run configs/smoke.yaml --fresh --out runs/smoke
	@$(BIN)/roughvol plot runs/smoke

# The sealing study of a gas takes most sections of a study.
OLD := build/lowest/env
lowest: $(PACKAGE)  ## run and plot a small study, and explain a section, with the lowest libraries of pyproject.toml
	@$(BIN)/uv build --quiet --system-certs --clear --wheel --out-dir build/lowest || { echo "not tried: uv builds no wheel here"; exit 0; }; \
	set -e; $(BIN)/uv venv --quiet --clear --python $(BIN)/python $(OLD); \
	$(BIN)/uv pip compile --quiet --system-certs --python $(OLD) --resolution lowest-direct --only-binary :all: \
		pyproject.toml --output-file build/lowest/pins.txt; \
	$(BIN)/uv pip install --quiet --system-certs --python $(OLD) --only-binary :all: \
		--constraint build/lowest/pins.txt build/lowest/*.whl; \
	$(OLD)/bin/roughvol run configs/gas_seal.yaml --set surface.m=3 --fresh --out runs/lowest; \
	$(OLD)/bin/roughvol plot runs/lowest leak_of_p; \
	$(OLD)/bin/roughvol explain surface > build/lowest/explain.txt

clean:  ## remove .venv, builds and results
	@rm -rf $(VENV) build *.egg-info runs/*/
