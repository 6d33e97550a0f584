PYTHON ?= python3
BIN := .venv/bin
OUT ?= out
GDSCRIPT := integrations/godot tests/integrations/godot benchmarks

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-camera lint format bench lock peers clean

help: ## Show this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

setup: .venv/.installed ## Make .venv from the pinned requirements (the other targets do this by themselves)

.venv/.installed: requirements.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Puppetline needs Python 3.11 or newer; call make PYTHON=python3.11 …")'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

demo: setup ## Animate the example characters into out/
	$(BIN)/puppetline demo --output $(OUT)

# matrices here are small: threads that wait for each other only cost time
test: export OPENBLAS_NUM_THREADS = 1
test: setup ## Run every test, two at a time (PYTEST="-m 'not slow'" for a quick round)
	$(BIN)/pytest -n 2 --dist loadfile $(PYTEST)

# MediaPipe wants an older NumPy than everything else: cameras are tested beside it, and so is what all else rests on
test-camera: export OPENBLAS_NUM_THREADS = 1
test-camera: .venv-camera/.installed ## Run the tests of cameras, and a quick round of others, on their older NumPy
	.venv-camera/bin/pytest -n 2 --dist loadfile tests/capture/sensors tests/engine_bridge/live/test_video.py
	.venv-camera/bin/pytest -n 2 --dist loadfile -m "not slow" tests/solver tests/capture --ignore tests/capture/sensors

.venv-camera/.installed: requirements-camera.txt pyproject.toml
	$(PYTHON) -m venv .venv-camera
	.venv-camera/bin/pip install --quiet --disable-pip-version-check --require-hashes -r requirements-camera.txt
	.venv-camera/bin/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

lint: setup ## Check style, types and which package may import which
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/gdformat --check --line-length 120 $(GDSCRIPT)
	$(BIN)/gdlint $(GDSCRIPT)

format: setup ## Rewrite the code in the project's style
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/gdformat --line-length 120 $(GDSCRIPT)

bench: setup ## Make the tables and plots of docs/performance.md anew (BENCH="--data FOLDER" with the Armadillo)
	$(BIN)/python -m benchmarks.performance $(BENCH)

peers: ## Install the outside programs that some tests compare with (needs npm)
	cd tests/peers && npm ci --no-audit --no-fund

COMPILE := uv pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	--no-emit-index-url --upgrade pyproject.toml

lock: ## Pin the newest versions of all dependencies (needs uv)
	$(COMPILE) --extra dev -o requirements.txt
	$(COMPILE) --extra camera --extra test -o requirements-camera.txt

clean: ## Remove the environment and everything made
	rm -rf .venv .venv-camera $(OUT) build *.egg-info .mypy_cache .pytest_cache .ruff_cache
