# One door for tools. `make reproduce` and `make test` work in a fresh clone on a machine with Python >= 3.11.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PAPER := gallery effect_of_D effect_of_m morphology
SEAL := seal seal_map seal_region
# Second readings of the paper's ambiguous passages, and more surfaces than it has: for the claims report.
READINGS := ten_seeds_of_m many_seeds morphology_of_D full_contact first_contact in_plane_scaling \
            reading_variance_law reading_variance_law_D reading_summit_plane

.PHONY: reproduce seal test test-slow coverage bench bench-peers validation extremes tradeoff lint setup smoke clean

setup: $(STAMP)

$(STAMP): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

reproduce: setup
	@for study in $(PAPER) $(READINGS); do $(BIN)/roughvol run configs/$$study.yaml || exit $$?; done
	@for study in $(PAPER); do $(BIN)/roughvol plot runs/$$study || exit $$?; done
	@$(BIN)/roughvol report $(PAPER) $(READINGS) --out runs/report --check tests/regression/expected_paper.json

seal: setup
	@for study in $(SEAL); do $(BIN)/roughvol run configs/$$study.yaml || exit $$?; done
	@for study in $(SEAL); do $(BIN)/roughvol plot runs/$$study || exit $$?; done
	@$(BIN)/roughvol report $(SEAL) --out runs/seal_report

# worksteal: each of the two takes half of the files in order, so that few fixtures are made twice.
test: setup
	@$(BIN)/python -m pytest -n 2 --dist worksteal

# Branch coverage of the tests: lines and branches that no test reaches. Worker processes are not measured.
coverage: setup
	@$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report=term

# Counts are held against tests/bench/baseline.json; seconds are printed, not judged.
bench: setup
	@$(BIN)/python -m tests.bench.solver --m 4 5 6 7 8 9 10 --rtol 1e-3 1e-6 --compare

# The other codes are for this alone (one of them is AGPL): installed when asked for, imported nowhere else.
bench-peers: setup
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,peers]'
	@$(BIN)/python -m tests.bench.peers

# Errors against closed forms, by resolution.
validation: setup
	@$(BIN)/python -m tests.bench.validation

# Speed against accuracy, and what each thing asked for costs, to docs/tradeoff.md: minutes.
tradeoff: setup
	@$(BIN)/roughvol tradeoff configs/tradeoff.yaml
	@$(BIN)/python -m tests.bench.asked

# Extremes of every input, to docs/extremes.md: minutes.
extremes: setup
	@$(BIN)/python -m tests.extremes

test-slow: setup
	@$(BIN)/python -m pytest -m slow --timeout 600

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

smoke: setup
	@$(BIN)/roughvol run configs/smoke.yaml --fresh --out runs/smoke
	@$(BIN)/roughvol plot runs/smoke

clean:
	@rm -rf $(VENV) build *.egg-info runs/*/
