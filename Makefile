# make run    renders a picture
# make test   runs all tests and linters
# make help   lists the rest

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.ONESHELL:
MAKEFLAGS += --no-builtin-rules --no-print-directory

PYTHON ?= python3
CARGO ?= cargo
WIDTH ?= 1280
HEIGHT ?= 720
SCENE ?= scenes/dream-car/dream-car.pov
PICTURE ?= out/$(basename $(notdir $(SCENE))).png
# Further arguments of `etendue render`, such as RENDER_ARGS="--spp 256 --tonemap agx".
RENDER_ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
WHEEL_VENV := target/wheel-venv
# The same for each call of cargo, by hand or by maturin, so that nothing is built twice: what the module is built for is in a file
# instead of being asked of an interpreter, and Python's library is not linked.
export PYO3_CONFIG_FILE := $(CURDIR)/crates/py/pyo3-build.txt
export PYO3_BUILD_EXTENSION_MODULE := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests, clippy and the Python module share one profile.
PROFILE := dev

# Tests may unwrap, panic and print, their helpers as well.
TEST_ALLOW := -A clippy::unwrap_used -A clippy::panic -A clippy::print_stdout -A clippy::print_stderr

.PHONY: help run build test lint test-rust test-python develop wheel fmt bench clean

help:
	@echo "make run      build and render $(SCENE) at $(WIDTH)x$(HEIGHT)"
	echo "make test     all tests and linters, of Rust and Python"
	echo "make lint     the linters alone"
	echo "make fmt      format all sources"
	echo "make build    the command: target/release/etendue"
	echo "make optimized  the same, profile-guided: target/optimized/etendue (needs llvm-profdata)"
	echo "make develop  the Python package in $(VENV), from the sources"
	echo "make wheel    a wheel of the Python package in target/wheels"
	echo "make clean    remove everything that was built"

build:
	$(CARGO) build --release --locked -p etendue-cli

# The same command, laid out and inlined by what it does on the repository's own scenes.
.PHONY: optimized
optimized:
	@$(PYTHON) scripts/build_optimized.py

run: build
	@mkdir -p "$(dir $(PICTURE))"
	start=$$(date +%s)
	target/release/etendue render "$(SCENE)" -o "$(PICTURE)" --width $(WIDTH) --height $(HEIGHT) --progress bar $(RENDER_ARGS)
	echo "The picture is $(abspath $(PICTURE)); it took $$(( $$(date +%s) - start )) s."

# The steps run one after the other: they share the cores and cargo's lock anyway. The quick ones come first.
test:
	@$(MAKE) lint
	$(MAKE) test-rust
	$(MAKE) test-python
	$(MAKE) test-browser
	echo "All tests and linters have passed."

lint: $(VENV)/installed
	$(CARGO) fmt --all --check
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/python scripts/check_dependencies.py
	$(BIN)/mypy
	$(CARGO) clippy --workspace --locked -- -D warnings
	$(CARGO) clippy --workspace --all-targets --locked -- -D warnings $(TEST_ALLOW)

test-rust: $(VENV)/installed
	$(CARGO) test --workspace --locked

# The package as developers have it, then as it is installed: a wheel in an environment of its own.
test-python: develop
	$(BIN)/python -m pytest
	$(MAKE) test-wheel

develop: $(VENV)/installed
	@skip=; if [[ $(VENV)/editable -nt pyproject.toml && $(VENV)/editable -nt $(VENV)/installed ]]; then skip=--skip-install; fi
	$(BIN)/maturin develop --profile $(PROFILE) --locked $$skip
	[[ -n $$skip ]] || touch $(VENV)/editable

.PHONY: test-wheel
test-wheel: $(WHEEL_VENV)/installed
	rm -rf target/test-wheel
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/pip wheel . --quiet --no-build-isolation --no-deps --no-index --wheel-dir target/test-wheel --config-settings=build-args="--profile $(PROFILE)"
	$(WHEEL_VENV)/bin/pip install --quiet --no-deps --no-index --force-reinstall target/test-wheel/etendue-*.whl
	cd target/test-wheel
	../wheel-venv/bin/python ../../scripts/check_wheel.py

# Baked scenes in Chromium with three.js. What is missing is said, and the test skipped.
.PHONY: test-browser
test-browser:
	@cd tests/browser
	if ! command -v node > /dev/null; then echo "SKIPPED: the browser test of baked scenes needs node and npm"; exit 0; fi
	[[ -d node_modules ]] || npm install --no-audit --no-fund --silent || echo "npm install has failed"
	node lightmap.mjs

wheel: $(VENV)/installed
	$(BIN)/maturin build --release --locked --out target/wheels

# Stamps: installed again only where the list of tools has changed.
$(VENV)/installed: requirements-dev.txt requirements-farm.txt requirements-console.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	echo "Installing the Python tools into $(VENV)"
	$(BIN)/pip install --quiet --requirement requirements-dev.txt --requirement requirements-farm.txt --requirement requirements-console.txt
	touch $@

$(WHEEL_VENV)/installed: requirements-dev.txt
	@rm -rf $(WHEEL_VENV)
	$(PYTHON) -m venv $(WHEEL_VENV)
	$(WHEEL_VENV)/bin/pip install --quiet $$(grep '^numpy' requirements-dev.txt | sed 's/ //g' | paste -sd' ')
	touch $@

fmt: $(VENV)/installed
	$(CARGO) fmt --all
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	$(CARGO) clean
	rm -rf $(VENV) out
