# Every target makes .venv when it is missing or older than pyproject.toml.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
CONFIG ?= configs/demo.toml
SEED   ?= 1
SPEED  ?= 10
OUT    ?= out/demo
DATA   ?= $(or $(SPRAYER_SHARED),../shared)/data
# What talks over simulated wires keeps their time and mostly waits: more workers than cores, and nothing beside it that
# takes all of the processor. The rest computes: as many workers as cores.
WIRES   := tests/contract tests/drivers $(wildcard tests/e2e/test_emulated*.py)
CORES   := $(shell nproc)
WORKERS ?= $(shell echo $$(($(CORES) * 3 / 2)))

HOURS  ?= 72

.PHONY: help demo test test-peers test-long soak check mutants bench bench-vision train clean

help:
	@echo "make demo       spray a simulated row and write a report (SEED=1 SPEED=10 CONFIG=configs/demo.toml)"
	@echo "make test       the test suite (about 8 minutes on two cores)"
	@echo "make test-peers independent programs talk to our drivers and emulators (gpsd, mbpoll, gammu, smsd, rustypot, systemd)"
	@echo "make test-long  the slow tests too"
	@echo "make soak       the whole robot for 72 hours of virtual time, everything goes wrong (HOURS=72 SEED=1)"
	@echo "make check      lint, types, architecture; every branch of safety and ledger has a test"
	@echo "make mutants    small errors put into the safety envelope one by one: every one must be found by its tests"
	@echo "make bench      speed and memory, measured"
	@echo "make bench-vision  how well and how fast both detectors and two rivals see: a page in out/bench-vision"
	@echo "make train       the detector's networks anew (DATA=folder of greenhouse and tomato_photos; about an hour and a half)"

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "sprayer needs Python 3.11 or newer")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(VENV)/.installed
	$(BIN)/sprayer demo --config $(CONFIG) --seed $(SEED) --speed $(SPEED) --out $(OUT)

test: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n $(WORKERS) -m "not long and not peer" $(WIRES)
	$(BIN)/python -m pytest -n $(CORES) -m "not long and not peer" tests $(WIRES:%=--ignore=%)

test-peers: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n 2 -m "peer and not long"

test-long: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n auto

soak: $(VENV)/.installed
	$(BIN)/sprayer soak --hours $(HOURS) --seed $(SEED)

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -q -n $(CORES) tests/robot/safety tests/robot/ledger --cov=robot/safety --cov=robot/ledger \
	    --cov-branch --cov-fail-under=100 --cov-report=term:skip-covered

$(VENV)/.installed-mutants: $(VENV)/.installed-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mutants]'
	touch $@

mutants: $(VENV)/.installed-mutants
	$(BIN)/python -m tests.mutants

bench: $(VENV)/.installed-dev
	$(BIN)/python -m tests.bench

bench-vision: $(VENV)/.installed-dev
	$(BIN)/python -m tests.bench.vision --out out/bench-vision

$(VENV)/.installed-train: $(VENV)/.installed-dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[train]'
	touch $@

train: $(VENV)/.installed-train
	$(BIN)/python -m drivers.twin.labelled_scenes --out out/train/twin --count 160 --seed 3
	$(BIN)/python -m robot.vision.training --rendered $(DATA)/greenhouse/train --twin out/train/twin \
	    --photos $(DATA)/tomato_photos --held-out $(DATA)/greenhouse/dev \
	    --out robot/vision/fruit/models --card docs/model-card.md

clean:
	rm -rf $(VENV) out
