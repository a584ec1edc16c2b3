# One command each on a machine with Python 3.11+, git and make.
#   make demo    the bundled engine CT, cast once and relit
#   make test    every check; what CI runs
#   make bench   comparisons with peers, each figure with its target
#   make gallery docs/gallery/raycast.md, cast again
#   make trust   the slow checks: further test cases, every basis against full
#                spectra, the time of fits, other systems and versions, ten minutes
#                in the viewer, fuzzed readers, killed writers, memory over 20 scenes
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_OUT ?= volspec-demo

.PHONY: demo test bench trust gallery lint clean
.DEFAULT_GOAL := demo

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "volspec needs Python 3.11 or newer; call make PYTHON=python3.12, say" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
		{ echo "no venv module; on Debian or Ubuntu: apt-get install python3-venv" >&2; exit 1; }

# uv installs in ten seconds, pip in two minutes; pip is the fallback if uv is missing or fails.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
INSTALL = { $(PIP) uv && $(BIN)/uv pip install --quiet --python $(BIN)/python --editable '$(1)'; } || \
	$(PIP) --editable '$(1)'
# Compile modules once, as tests start some hundred programs.
unexport PYTHONDONTWRITEBYTECODE

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@$(call INSTALL,.)
	@tools/system-packages.sh $(BIN)/python
	@touch $@

$(VENV)/.installed-test: pyproject.toml | $(BIN)/python
	@$(call INSTALL,.[test])
	@tools/system-packages.sh $(BIN)/python test
	@touch $@ $(VENV)/.installed

demo: $(VENV)/.installed
	$(BIN)/volspec demo --out $(DEMO_OUT)

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# One worker per core, so BLAS gets one thread; files in order, the smallest last.
test: lint
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

bench: $(VENV)/.installed-test
	$(BIN)/python -m benchmarks

gallery: $(VENV)/.installed
	$(BIN)/python -m tools.gallery

trust: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto -m slow
	$(BIN)/python -m benchmarks.basis
	$(BIN)/mypy --platform win32
	$(BIN)/mypy --platform darwin
	$(BIN)/python -m tools.installs
	$(BIN)/python -m benchmarks.session 600
	$(BIN)/python -m benchmarks.fuzz --seconds 20
	$(BIN)/python -m benchmarks.kills
	$(BIN)/python -m benchmarks.drift

clean:
	rm -rf $(VENV) build dist volspec-demo .pytest_cache .mypy_cache .ruff_cache
