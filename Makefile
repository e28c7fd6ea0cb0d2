# make report   sets up, then makes the error report of a built-in scene
# make test     sets up, then runs all checks but the slow tests
# make test-quick  a part of them, in under a minute
SCENE ?= car
OUT ?= report

XFRUSTUM := .venv/bin/xfrustum
READY := .venv/.ready

# Every start of a program compiles some 1,200 modules, four seconds of a processor, unless one has written them.
unexport PYTHONDONTWRITEBYTECODE

# One of each: what a module may be, the geometry of lines and plates, a truth, a raster image, a comparison, a
# verdict, and the command line's answers. CONTRIBUTING.md, "Test", says what this leaves out.
QUICK := tests/test_architecture.py tests/scenes/plate tests/scenes/model/test_arguments.py \
	tests/scenes/files/test_scene_file.py tests/reference/test_lines.py \
	'tests/reference/test_reference.py::test_every_line_shows_what_brute_force_shows[asymmetric-resolution4-aperture4]' \
	tests/raster/test_raster.py tests/compare/metrics/test_compare.py \
	'tests/compare/diagnosis/test_diagnosis.py::test_in_a_renderer_that_is_right_nothing_is_named' \
	'tests/compare/diagnosis/test_diagnosis.py::test_defects_are_named_with_their_sizes_alone_and_in_pairs[near]' \
	tests/cli/test_cli.py

.PHONY: help report test test-quick test-all test-blender test-device fuzz kill setup lock docs clean

help:
	@echo 'make report    error report of a built-in scene (SCENE=$(SCENE) OUT=$(OUT))'
	@echo 'make test      all checks but the slow tests: ruff, pyrefly, import-linter, pytest'
	@echo 'make test-quick  one of each of them, in under a minute'
	@echo 'make test-all  the same, with mypy and the slow tests'
	@echo 'make test-blender  the tests that need Blender, which it installs into build/blender (900 MB)'
	@echo 'make test-device  how the graphics card at hand does, in 8 minutes and without a network: build/device-report.md'
	@echo 'make fuzz      10,000 damaged inputs of every kind (FUZZ_ARGS="--kind mesh --count 100")'
	@echo 'make kill      signals at random moments of every command (KILL_ARGS="--count 5")'
	@echo 'make setup     only the set-up: system packages where they are missing, and .venv'
	@echo 'make docs      the documentation with its gallery: build/docs/index.html'
	@echo 'make lock      write requirements.lock anew (LOCK=--upgrade for the newest versions)'
	@echo 'make clean     remove what the commands above made, .venv included'

report:
	@echo "Error report of the scene '$(SCENE)': sets up where that was not done, then traces the truth of the middle"
	@echo "aperture and draws it with 25 near planes and 5 depth buffers, under a minute; the page is $(OUT)/index.html."
	@$(MAKE) --no-print-directory setup
	@mkdir -p build
	@$(XFRUSTUM) report $(SCENE) --out $(OUT) >build/report.txt
	@tail -n +2 build/report.txt; head -n 1 build/report.txt  # the path of the page, then the sentence

docs: setup
	scripts/make_docs.sh

test: PYTEST_ARGS ?=
test-all: PYTEST_ARGS ?= -m ''
test test-all: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyrefly check
	.venv/bin/lint-imports
	$(if $(filter test-all,$@),.venv/bin/mypy)
	.venv/bin/pytest $(PYTEST_ARGS)

test-quick: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/lint-imports
	.venv/bin/pytest $(QUICK) $(PYTEST_ARGS)

setup: $(READY)
	@echo "Set up: $(XFRUSTUM)"

$(READY): requirements.lock pyproject.toml $(wildcard scripts/*)
	@echo 'Set-up:'
	@scripts/system_packages.sh
	@scripts/make_venv.sh
	@touch $@

test-blender: setup
	scripts/make_blender_venv.sh
	.venv/bin/pytest -m '' tests/reports/exchange/test_blender.py $(PYTEST_ARGS)

# No step of the set-up, which may need a network, where this Python or an environment has xfrustum.
test-device:
	@python=python3; test ! -x .venv/bin/python || python=.venv/bin/python; \
	$$python -c 'import xfrustum' 2>/dev/null || { $(MAKE) --no-print-directory setup && python=.venv/bin/python; }; \
	$$python -m tests.device_report

fuzz: setup
	.venv/bin/python -m tests.fuzz $(FUZZ_ARGS)

kill: setup
	.venv/bin/python -m tests.fuzz.kill $(KILL_ARGS)

lock:
	scripts/lock.sh $(LOCK)

clean:
	rm -rf .venv build dist report docs/api/names docs/gallery .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
