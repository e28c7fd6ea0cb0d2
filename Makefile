# make report   sets up, then makes the error report of a built-in scene
# make test     sets up, then runs all checks
SCENE ?= car
OUT ?= report

XFRUSTUM := .venv/bin/xfrustum
READY := .venv/.ready

.PHONY: help report test test-all fuzz kill setup lock clean

help:
	@echo 'make report    error report of a built-in scene (SCENE=$(SCENE) OUT=$(OUT))'
	@echo 'make test      all checks: ruff, mypy, import-linter, pytest'
	@echo 'make test-all  the same, with the slow tests'
	@echo 'make fuzz      10,000 damaged inputs of every kind (FUZZ_ARGS="--kind mesh --count 100")'
	@echo 'make kill      signals at random moments of every command (KILL_ARGS="--count 5")'
	@echo 'make setup     only the set-up: system packages where they are missing, and .venv'
	@echo 'make lock      write requirements.lock anew (LOCK=--upgrade for the newest versions)'
	@echo 'make clean     remove what the commands above made, .venv included'

report: setup
	$(XFRUSTUM) report $(SCENE) --out $(OUT)

test: PYTEST_ARGS ?=
test-all: PYTEST_ARGS ?= -m ''
test test-all: setup
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/lint-imports
	.venv/bin/pytest $(PYTEST_ARGS)

setup: $(READY)
	@echo "Set up: $(XFRUSTUM)"

$(READY): requirements.lock pyproject.toml $(wildcard scripts/*)
	scripts/system_packages.sh
	scripts/make_venv.sh
	@touch $@

fuzz: setup
	.venv/bin/python -m tests.fuzz $(FUZZ_ARGS)

kill: setup
	.venv/bin/python -m tests.fuzz.kill $(KILL_ARGS)

lock:
	scripts/lock.sh $(LOCK)

clean:
	rm -rf .venv build dist report .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
