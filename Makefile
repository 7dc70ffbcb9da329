# tpmsd: what one types. Every target sets up its own environment in .venv when that is missing or out of date;
# once set up, nothing here needs the network.

VENV ?= .venv
export PYTHON
PY := $(VENV)/bin/python
PIP := $(PY) -m pip --disable-pip-version-check -q

# The stamps' names hold a checksum of what was installed and of where the clone lies, so that a new dependency or
# a moved clone sets the environment up again, while a mere `git checkout` (new file times) does not.
SETUP_ID := $(shell { cat pyproject.toml; pwd; } | cksum | cut -d' ' -f1)
RUNTIME := $(VENV)/.runtime-$(SETUP_ID)
DEV := $(VENV)/.dev-$(SETUP_ID)

# Tests run on all cores, one per process: numpy's own threads would only fight for the same cores.
PYTEST_JOBS ?= auto
PYTEST_ARGS ?=
# No test is asynchronous: what comes along with httpx would import trio in each worker.
PYTEST_FLAGS = -n $(PYTEST_JOBS) -p no:anyio
# Bytecode is kept, whatever the shell says: without it each worker rewrites and compiles all tests again.
unexport PYTHONDONTWRITEBYTECODE
# Whole drives, recordings, every command's manual page and hostile archives are left to `make test`.
FAST = tests/test_house.py tests/car/config tests/interfaces/cli tests/onboard/sinks tests/onboard/sources_can tests/onboard/timeline tests/onboard/gnss \
	--ignore=tests/interfaces/cli/test_explain.py --ignore=tests/interfaces/cli/test_completion.py \
	--ignore=tests/onboard/timeline/test_block_source.py --ignore=tests/onboard/timeline/test_tick_source_pace.py \
	--ignore=tests/onboard/sources_can/test_packed_bounds.py --ignore=tests/onboard/sources_can/test_candump_text.py \
	--ignore=tests/onboard/sources_can/test_recordings.py --ignore=tests/onboard/gnss/test_recordings.py
# The live path, from frames to alarms; measured by the tests of these packages alone.
CORE = config sources timeline estimators monitor sinks pipeline physics inference resonance vehicle_state
CORE_TESTS = tests/car/config tests/onboard/sources_can tests/onboard/gnss tests/onboard/timeline tests/onboard/estimators tests/onboard/monitor tests/onboard/sinks \
	tests/car/physics tests/offline/inference tests/onboard/resonance tests/car/vehicle_state tests/onboard/test_pipeline.py \
	tests/onboard/test_two_buses.py tests/onboard/test_plain_nmea.py tests/interfaces/cli/test_explain.py
DEMO_ARGS ?=
SEED ?= 1
BENCH_ARGS ?=
SOAK_ARGS ?=
ATTACKS_ARGS ?=
FUZZ_ARGS ?=
MUTATION_ARGS ?=
HIL_ARGS ?=
FROM_NOTHING_ARGS ?=

# What `make install` and `make deb` bring along: extras of pyproject.toml, such as EXTRAS=report,mqtt.
EXTRAS ?=
export EXTRAS
# Where `make install` puts things; DESTDIR comes before all of them.
PREFIX ?= /opt/tpmsd
BINDIR ?= /usr/local/bin
UNITDIR ?= /usr/local/lib/systemd/system
DOCDIR ?= /usr/local/share/doc/tpmsd
MANDIR ?= /usr/local/share/man

.DEFAULT_GOAL := help
.PHONY: help demo proof test tests style types test-fast coverage test-from-nothing docs release lint format bench bench-live bench-calibrate bench-diagnose bench-origins bench-alarms test-hil test-connect test-web test-qemu install uninstall deb bench-vehicle-state bench-estimators bench-fleet soak attacks fuzz mutation clean

help:  ## this list
	@sed -n -e 's/^##@ /\n/p' -e 's/^\([a-z-]*\):.*## /\1\t/p' $(firstword $(MAKEFILE_LIST)) | \
		awk -F'\t' 'NF == 2 {printf "  make %-20s %s\n", $$1, $$2; next} {print}'

##@ Try it

demo: $(RUNTIME)  ## a simulated slow puncture, found and announced on a virtual CAN bus (DEMO_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tpmsd.interfaces.cli.demo $(DEMO_ARGS)

proof: $(RUNTIME)  ## concealed effects sealed, found, opened, scored; a page in build/proof (SEED=1)
	@$(PY) -c 'import pysindy, gplearn, matplotlib' 2>/dev/null || $(PIP) install -e '.[proof]' || \
		echo "Without the other methods and pictures, which need the network: $(PIP) install -e '.[proof]'"
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run proof --seed $(SEED) --page build/proof/index.html

##@ Work on it

test: style types tests  ## style, types and all tests (PYTEST_ARGS=..., PYTEST_JOBS=...; -j2: types beside the tests)

# Tests that call make are to find no trace of this one.
tests: $(DEV)
	env -u MAKEFLAGS -u MFLAGS OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m pytest $(PYTEST_FLAGS) --dist worksteal $(PYTEST_ARGS)

test-fast: lint  ## style, types and the quick tests, under a minute
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m pytest $(PYTEST_FLAGS) $(FAST) $(PYTEST_ARGS)

lint: style types  ## style and types only

style: $(DEV)
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .

types: $(DEV)
	$(PY) -m mypy

format: $(DEV)  ## format the sources
	$(PY) -m ruff check --fix .
	$(PY) -m ruff format .

coverage: $(DEV)  ## branch coverage of the core by its own tests, as a table by package (some minutes)
	@mkdir -p build/coverage
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m pytest -n $(PYTEST_JOBS) --cov --cov-report= \
		--cov-report=json:build/coverage/core.json $(CORE_TESTS) $(PYTEST_ARGS)
	$(PY) tools/coverage_table.py build/coverage/core.json $(CORE)

test-hil: $(DEV)  ## the daemon on a real CAN stack and as a real service (HIL_ARGS=..., TPMSD_SKIP_HIL=1)
	$(PY) -m tests.hil.run $(HIL_ARGS)

test-from-nothing: $(DEV)  ## README and docs from nothing on a new Debian 12 or 13: takes root (FROM_NOTHING_ARGS="--suite trixie")
	$(PY) -m tests.hil.from_nothing $(FROM_NOTHING_ARGS)

test-connect: $(DEV)  ## against real gpsd, mosquitto, prometheus, dbus (installed: gpsd mosquitto prometheus openssl dbus)
	TPMSD_CONNECT=1 OMP_NUM_THREADS=1 $(PY) -m pytest -n 0 -rs tests/connect

test-web: $(DEV)  ## the pages of tpmsd web in a real browser (Chromium and its driver)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m pytest -m browser tests/browser -rs

test-qemu: $(DEV)  ## smoke tests, one drive and instruction counts on aarch64 (installed: qemu-user mmdebstrap gcc)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.qemu.run

soak: $(DEV)  ## a day of driving with one fault after the other, in logical time (SOAK_ARGS="--hours 1", --week)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.faults.soak $(SOAK_ARGS)

attacks: $(DEV)  ## the attacks of SECURITY.md on three drives with both filters, as a table, and its tests (ATTACKS_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.faults.attacks --tests $(ATTACKS_ARGS)

fuzz: $(DEV)  ## C parts under sanitizers, then all that takes bytes, guided by coverage (FUZZ_ARGS="--seconds 600 nmea")
	@$(PY) -c 'import atheris' 2>/dev/null || $(PIP) install -e '.[fuzz]'
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.fuzz.sanitized
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.fuzz.run $(FUZZ_ARGS)

mutation: $(DEV)  ## are the tests tested: mutants of monitor, counters, epochs, state, health, links (MUTATION_ARGS=--named)
	@$(PY) -c 'import cosmic_ray' 2>/dev/null || $(PIP) install -e '.[mutation]'
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m tests.mutation.run $(MUTATION_ARGS)

##@ Install and publish

PLACES = DESTDIR="$(DESTDIR)" PREFIX="$(PREFIX)" BINDIR="$(BINDIR)" UNITDIR="$(UNITDIR)" DOCDIR="$(DOCDIR)" MANDIR="$(MANDIR)"

install: $(RUNTIME)  ## program and service onto this machine (EXTRAS=report,mqtt PREFIX=..., DESTDIR=...)
	@$(PLACES) PIP="$(PIP)" sh tools/install.sh install

uninstall:  ## take them away again; configuration and what was learned stay
	@$(PLACES) sh tools/install.sh uninstall

deb: $(RUNTIME)  ## a Debian package, to build/deb (EXTRAS=...)
	@PIP="$(abspath $(PY)) -m pip --disable-pip-version-check -q" sh tools/make_deb.sh

docs: $(DEV)  ## the site, with its links checked, to build/site: works offline
	@NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --strict -q

release: $(DEV)  ## wheels, sdist, Debian package and SBOM: built, checked, with their hashes; twice the same
	@$(PY) -c 'import ziglang, auditwheel' 2>/dev/null || $(PIP) install -e '.[release]'
	@PY="$(abspath $(PY))" sh tools/release.sh

##@ Measure

bench: $(RUNTIME)  ## the figures of the README, measured on this machine (BENCH_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run speed $(BENCH_ARGS)

bench-live: $(RUNTIME)  ## rate, lateness and CPU time of the daemon on a full bus, in real time (BENCH_ARGS=--guest)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run live $(BENCH_ARGS)

bench-calibrate: $(DEV)  ## the published experiment, its method and ours (BENCH_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run calibrate $(BENCH_ARGS)

bench-diagnose: $(DEV)  ## the diagnosis on drives of other worlds, truth sealed (BENCH_ARGS=--full: a day)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run diagnosis $(BENCH_ARGS)

bench-origins: $(DEV)  ## the diagnosis on null drives and faults of eight origins (BENCH_ARGS=--help)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run origins $(BENCH_ARGS)

bench-alarms: $(DEV)  ## soft tyres and harmless drives: detection, false alarms per km (BENCH_ARGS=--full: hours)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run alarms $(BENCH_ARGS)

bench-vehicle-state: $(DEV)  ## Liu et al.'s (2022) experiment, and what its slips do for the tyres (BENCH_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run vehicle-state $(BENCH_ARGS)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run slip-gate

bench-estimators: $(DEV)  ## Lundquist et al.'s (2013) comparison of filters, and beyond it (BENCH_ARGS=--full: hours)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run estimators $(BENCH_ARGS)

bench-resonance: $(DEV)  ## which sampling shows the torsional resonance of a soft tyre (BENCH_ARGS=...)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run resonance $(BENCH_ARGS)

bench-fleet: $(DEV)  ## a fleet on workers against a plain loop, and the joint inference (BENCH_ARGS=--help)
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(PY) -m bench run fleet $(BENCH_ARGS)

##@ Tidy up

clean:  ## remove the environment and everything that was made
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .coverage demo-out bench-out
	find tpmsd tests -name __pycache__ -type d -prune -exec rm -rf {} +

define make_venv
@if ! $(PY) -m pip --version >/dev/null 2>&1; then \
	python=$$(sh tools/find_python.sh) && echo "Setting up $(VENV) with $$python" >&2 && \
	"$$python" -m venv --clear $(VENV); \
fi
endef

$(RUNTIME):
	$(make_venv)
	@echo "Installing the run-time dependencies (once)" >&2
	@$(PIP) install -e .
	@rm -f $(VENV)/.runtime-* && touch $@

$(DEV):
	$(make_venv)
	@echo "Installing the development dependencies (once)" >&2
	@$(PIP) install -e '.[dev]'
	@rm -f $(VENV)/.runtime-* $(VENV)/.dev-* && touch $(RUNTIME) $@
