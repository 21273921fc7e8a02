# Every habit of this project is a target. `make help` lists them.
#
# The first target that needs it makes a Python environment in .venv and builds the package into it. Nothing is
# installed outside the checkout but the Rust crates in cargo's own cache.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := Cargo.toml Cargo.lock pyproject.toml python/streamseg/_core.pyi $(shell find src -name '*.rs')
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
READY := $(VENV)/.ready
BUILT := $(VENV)/.built
TOOLS := $(VENV)/.tools

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

demo: $(BUILT) ## make a scene, segment it as a stream, leave pictures and files in demo/
	@$(BIN)/streamseg demo demo

test: lint test-rust test-python ## every check and every test

lint: $(BUILT) $(TOOLS) ## format, lints, types and stubs; any warning fails
	@cargo fmt --version >/dev/null 2>&1 && cargo clippy --version >/dev/null 2>&1 || { echo "streamseg: the checks need rustfmt and clippy; get them with: rustup component add rustfmt clippy"; exit 1; }
	cargo fmt --check
	cargo clippy --quiet --all-targets -- -D warnings
	cargo clippy --quiet --features python -- -D warnings
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest streamseg._core

test-rust: check-tools ## the core, without Python
	cargo test --quiet
	LOOM_MAX_PREEMPTIONS=2 RUSTFLAGS="--cfg loom" cargo test --quiet --profile model --target-dir target/loom --test weaver_model

test-python: $(BUILT) $(TOOLS) ## the package, on real clouds too (STREAMSEG_DATA)
	$(BIN)/python -m pytest --quiet --numprocesses auto --dist loadfile

bench: check-tools ## points per second of segmentor, weaver and pipeline
	cargo bench

figures: $(BUILT) $(TOOLS) ## the paper's figures 5 and 6, into figures/
	$(BIN)/python benches/figures.py --out figures

model: check-tools ## every interleaving of the look-up tables (minutes)
	RUSTFLAGS="--cfg loom" cargo test --profile model --target-dir target/loom --test weaver_model

fuzz: $(BUILT) $(TOOLS) ## the properties with many more cases (an hour)
	PROPTEST_CASES=20000 cargo test --release --test streamed_is_static --test canonical_delaunay --test front --test finalized --test revisit --test wider_looks --test planned --test weaver_is_sequential --test expression_trees
	STREAMSEG_CRITERIA=10000000 cargo test --release --test expression_fuzz -- --nocapture
	STREAMSEG_EXAMPLES=2000 $(BIN)/python -m pytest --quiet tests

experiments: $(BUILT) $(TOOLS) ## improved region growing's experiment, and roofs as planes, into figures/
	@mkdir -p figures
	$(BIN)/python benches/region_growing.py --picture figures/region-growing.png
	$(BIN)/python benches/planes.py --out figures

proof: $(BUILT) $(TOOLS) ## streamed against static on the measured clouds, into figures/ (an hour or two)
	$(BIN)/python benches/proof.py
	$(BIN)/python benches/proof.py --orders --out figures/proof-orders.csv

soak: $(BUILT) $(TOOLS) ## memory and speed on long clouds, beside scipy
	$(BIN)/python benches/memory.py
	$(BIN)/python benches/peers.py

cases: $(BUILT) $(TOOLS) ## what people's files and habits do to it (STREAMSEG_CASES)
	$(BIN)/python benches/cases.py

torture: $(BUILT) $(TOOLS) ## thousands of damaged files, odd arrays and odd options (a quarter of an hour)
	$(BIN)/python benches/torture

wheel: check-tools ## a wheel for any Python from 3.10 on, in dist/
	$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir dist .

clean: ## remove what was built
	rm -rf target $(VENV) demo dist figures

$(BUILT): $(READY) $(SOURCES)
	@echo "building streamseg (the first time takes a minute or two) ..."
	@PIP_QUIET=1 PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/maturin develop --release --extras all \
		>$(VENV)/build.log 2>&1 || { cat $(VENV)/build.log; exit 1; }
	@touch $@

$(READY): pyproject.toml | check-tools
	@$(PYTHON) -m venv $(VENV) || { echo "streamseg: $(PYTHON) cannot make environments; install its venv module (on Debian: apt install python3-venv)"; exit 1; }
	@$(PIP) install --upgrade "pip>=25.1"
	@$(PIP) install "maturin>=1.9.4,<2"
	@touch $@

$(TOOLS): $(READY)
	@echo "installing what the checks and the tests need ..."
	@$(PIP) install --group dev
	@touch $@

check-tools:
	@command -v $(PYTHON) >/dev/null || { echo "streamseg: needs Python 3.10 or newer as '$(PYTHON)'; get it from your system's packages, or name another with PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "streamseg: needs Python 3.10 or newer, '$(PYTHON)' is $$($(PYTHON) -V); name another with PYTHON=..."; exit 1; }
	@command -v cargo >/dev/null || { echo "streamseg: needs a Rust toolchain (cargo); get it with rustup, see https://rustup.rs"; exit 1; }

.PHONY: help demo test lint test-rust test-python bench figures experiments proof model fuzz soak cases torture wheel clean check-tools
