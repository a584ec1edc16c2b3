# One command each on a machine with Python 3.11+, git and make.
#   make demo    the bundled engine CT, cast once and relit
#   make quick   values only (spectra, appearance, basis, scene …): after every save
#   make test    linters, and all that the README promises, on every stage
#   make trust   everything else: further cases (`make test-more`, which CI runs, too),
#                random order, 2,000 pairs of scenes that look alike, every basis against
#                full spectra, other systems and versions, ten minutes in the viewer, fuzzed
#                readers, killed writers, memory over 20 scenes
#   make bench   comparisons with peers, each figure with its target
#   make gallery docs/gallery/raycast.md, cast again
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO_OUT ?= volspec-demo

.PHONY: demo quick test suite test-more trust bench gallery lint clean
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
	@$(call INSTALL,.[all])
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

# One worker per core, so BLAS gets one thread. A free worker takes the next file; the dearest
# files come first.
PYTEST = OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile

quick: $(VENV)/.installed-test
	$(PYTEST) --quick

# mypy takes one core half a minute, and the suite goes on meanwhile.
test: $(VENV)/.installed-test
	@$(MAKE) --no-print-directory -j 2 lint suite

suite: $(VENV)/.installed-test
	$(PYTEST) -m 'not slow'

test-more: $(VENV)/.installed-test
	$(PYTEST) -m slow

bench: $(VENV)/.installed-test
	$(BIN)/python -m benchmarks

gallery: $(VENV)/.installed
	$(BIN)/python -m tools.gallery

trust: test-more
	for seed in 1 2 3; do $(PYTEST) -m 'not slow' -p randomly --randomly-seed=$$seed || exit 1; done
	RELATIONS=100:230 $(PYTEST) -m slow tests/raycast/test_relations.py
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
