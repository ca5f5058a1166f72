# Two commands on a fresh machine: `make demo` and `make test`. PYTHON is any of 3.10 to 3.13.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := setup.py setup.cfg package.xml constraints.txt $(shell find offradar_ros scripts params launch resource -type f -not -name '*.pyc')
# One thread in each test process: more would wait for one another, on a busy machine for most of the time.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo test lint test-fast bench bench-check faults bag clean

demo: $(VENV)/.demo
	$(BIN)/offradar demo

test: lint
	$(PYTEST)

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Without the tests that start nodes.
test-fast: $(VENV)/.test
	$(PYTEST) --ignore test/nodes

# The figures that benchmarks/README.md explains, into BENCH; of driving with each encoder, SECONDS.
SECONDS ?= 60
BENCH ?= benchmarks/results
PICTURES ?= docs
bench: $(VENV)/.bench
	mkdir -p $(BENCH)
	$(BIN)/python benchmarks/pipeline.py --seconds $(SECONDS) --out $(BENCH)/pipeline.json
	$(BIN)/python benchmarks/throughput.py --out $(BENCH)/throughput.json
	$(BIN)/python benchmarks/encoders.py --out $(BENCH)/encoders.json --picture $(PICTURES)/encoder_cost.png
	$(BIN)/python benchmarks/search.py --out $(BENCH)/search.json --picture $(PICTURES)/search_cost.png

# The same again, against the ratios that are committed.
bench-check:
	$(MAKE) bench BENCH=build/bench/results PICTURES=build/bench/results SECONDS=30
	$(BIN)/python benchmarks/check_ratios.py build/bench/results

# Damage, kills, power cuts and overload: at most six minutes, status 1 if anything crashed, changed silently or was lost.
faults: $(VENV)/.test
	$(BIN)/python benchmarks/fault_campaigns.py --out $(BENCH)/faults.json --page docs/reliability.md

# Makes the recording in bags/ again.
bag: $(VENV)/.demo
	$(BIN)/offradar simulate city --out bags --sessions 1 --scans 10 --seed 1 --overwrite

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 10) <= v <= (3, 13) else "expected Python 3.10 to 3.13, got %d.%d: name one, as in make PYTHON=python3.12" % v)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: $(VENV)/bin/python $(SOURCES)
	$(INSTALL) '.[ros,plot]'
	touch $@

$(VENV)/.test: $(VENV)/bin/python $(SOURCES)
	$(INSTALL) '.[ros,plot,torch,test]'
	touch $@

$(VENV)/.bench: $(VENV)/.test
	$(INSTALL) '.[bench]'
	touch $@

clean:
	rm -rf $(VENV) build demo_output *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
