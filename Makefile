# Works on a fresh machine that has only Python 3.11 or newer; everything else goes into .venv.
PYTHON ?= python3
VENV ?= .venv
OUT ?= out
BIN := $(VENV)/bin
# the order of files is that of tests/conftest.py; a process that crashes is a defect (CONTRIBUTING.md): the run ends there
PARALLEL := -q -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart=0
# the tests in groups, each in processes of its own, all of them even if one fails: one that has compiled hundreds of kinds of scenes may crash in llvmlite
GROUP_1 := $(addprefix tests/,compile dynamics gradients interface kernels linalg model)
GROUP_2 := $(addprefix --ignore=,$(GROUP_1) tests/validation tests/house) tests
GROUP_3 := $(wildcard tests/validation/test_[a-m]*.py)
GROUP_4 := $(addprefix --ignore=,$(GROUP_3)) tests/validation tests/house
# what `make test-plain` runs: masses on rods by every method and solver; numba alone compiles for minutes
PLAIN_TESTS ?= tests/validation/test_distance_joint.py
RECENT := import sys; sys.exit(sys.version_info < (3, 11))

.PHONY: help demo test test-slow test-plain lint api docs pictures study peers perf perf-compare perf-limits clean

help:
	@echo "make demo       install into $(VENV) and run the example ring_on_cable (pictures in $(OUT)/)"
	@echo "make test       install into $(VENV) and run the tests, without the long ones"
	@echo "make test-slow  the long physics runs"
	@echo "make test-plain PLAIN_TESTS=files   tests with kernels that numba compiles alone (FASTBEAM_PLAIN_NUMBA=1): slow"
	@echo "make lint       ruff, as the tests run it"
	@echo "make api        write the list of public names and arguments anew (tests/public_api.txt)"
	@echo "make docs       the pages of docs/ as a site in $(OUT)/site"
	@echo "make pictures   run all tutorials and examples of the gallery, and draw their pictures anew"
	@echo "make study      compare methods of time integration, and error against run time (docs/reports)"
	@echo "make peers      the same scenes with other programs, each installed into .peers/ (docs/reports/peers.png)"
	@echo "make perf       the benchmark suite (perf/suite/regression.py); values as JSON in $(OUT)/perf.json"
	@echo "make perf-compare BASE=revision   the suite on this state and on another in turn; fails where this one is slower"
	@echo "make perf-limits   scaling, roofline and goals (docs/reports/performance.md); needs a quiet machine and an hour"
	@echo "make clean      remove $(VENV), $(OUT) and caches"

demo: $(VENV)/.installed
	$(BIN)/python -m fastbeam run ring_on_cable --out $(OUT)

test: $(VENV)/.installed-dev
	failed=0; $(foreach k,1 2 3 4,$(BIN)/python -m pytest $(PARALLEL) $(GROUP_$(k)) || failed=1;) exit $$failed

test-slow: $(VENV)/.installed-dev
	failed=0; $(foreach k,1 2 3 4,$(BIN)/python -m pytest $(PARALLEL) -m slow $(GROUP_$(k)) || failed=1;) exit $$failed

test-plain: $(VENV)/.installed-dev
	FASTBEAM_PLAIN_NUMBA=1 $(BIN)/python -m pytest -q $(PLAIN_TESTS)

lint: $(VENV)/.installed-dev
	$(BIN)/python -m ruff check .

api: $(VENV)/.installed
	$(BIN)/python tests/house/test_public_api.py

docs: $(VENV)/.installed
	$(BIN)/python -m pip install --disable-pip-version-check -q -e ".[docs]"
	$(BIN)/python -m mkdocs build --strict --site-dir $(abspath $(OUT))/site

pictures: $(VENV)/.installed
	$(BIN)/python docs/pages.py

study: $(VENV)/.installed
	$(BIN)/python examples/study/run.py
	$(BIN)/python examples/study/work_precision.py

.peers/.installed: perf/peers/environments.py | $(VENV)/.installed
	$(BIN)/python perf/peers/environments.py
	@touch $@

peers: $(VENV)/.installed .peers/.installed
	$(BIN)/python perf/peers/run.py

perf: $(VENV)/.installed
	@mkdir -p $(OUT)
	$(BIN)/python perf/suite/regression.py --large --json $(OUT)/perf.json

perf-compare: $(VENV)/.installed
	@test -n "$(BASE)" || { echo "perf-compare: name a revision, as in make perf-compare BASE=main~5"; exit 2; }
	$(BIN)/python perf/suite/compare.py $(BASE)

perf-limits: $(VENV)/.installed
	@mkdir -p $(OUT)
	$(BIN)/python perf/limits/roofline.py --json $(OUT)/roofline.json
	$(BIN)/python perf/limits/goals.py --large --json $(OUT)/goals.json
	$(BIN)/python perf/limits/scaling.py --json $(OUT)/scaling.json

# the first Python in the list that is recent enough makes the environment
$(BIN)/python:
	@for python in "$(PYTHON)" python3.11 python3.12 python3.13 python3.14; do \
		if "$$python" -c "$(RECENT)" >/dev/null 2>&1; then \
			echo "making $(VENV) with $$python"; "$$python" -m venv "$(VENV)" && exit 0; \
			rm -rf "$(VENV)"; echo "cannot make $(VENV); on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; \
		fi; \
	done; \
	echo "fastbeam needs Python 3.11 or newer; '$(PYTHON)' is missing or older." >&2; \
	echo "Install one, or name it: make demo PYTHON=python3.12" >&2; exit 1

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --disable-pip-version-check -q -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --disable-pip-version-check -q -e ".[dev]"
	@touch $@ $(VENV)/.installed

clean:
	rm -rf "$(VENV)" "$(OUT)" .pytest_cache .hypothesis build dist
