# One command each: `make demo`, `make test`. Needs git, make and Python 3.11 or newer, no more.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

# Every library has a pool of threads of its own, and on few cores they get in each other's way.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# Tests start many processes: sources are compiled once, also where the shell forbids to keep that.
export PYTHONDONTWRITEBYTECODE :=

# To choose another: `make test PYTHON=/path/to/python`.
PYTHON ?=
PYTHONS := $(or $(PYTHON),python3.13 python3.12 python3.11 python3)
VENV := .venv
BIN := $(VENV)/bin
SITE := site
DEMO := demo
DEMO_OUT := $(DEMO)/results/accessory

# uv takes 5 s where pip takes 40. Of pip's settings it knows these only; where it fails, pip installs.
# Neither compiles: Python compiles what is imported by itself. `editables` is asked for when hatchling
# builds, where uv does not look.
ifdef PIP_INDEX_URL
export UV_DEFAULT_INDEX ?= $(PIP_INDEX_URL)
endif
ifdef PIP_FIND_LINKS
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)
endif
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
install = ($(PIP) uv && $(BIN)/python -m uv pip install --quiet -c constraints.txt $(1) editables) || \
  $(PIP) -c constraints.txt $(1)

.PHONY: help demo test types suite test-slow test-faults golden-check golden-record bench measure docs clean

help:
	@echo 'make demo         a gear pair from scene to pictures, in $(DEMO)/'
	@echo 'make test         format, lint, types, tests'
	@echo 'make test-slow    the tests that take minutes'
	@echo 'make test-faults  plants faults in the sources, and sees whether the tests catch them'
	@echo 'make golden-check compares what commands write with what was recorded (golden-record)'
	@echo 'make bench        timings'
	@echo 'make measure      counts of the sources, beside those of version 0.8'
	@echo 'make docs         the documentation, in $(SITE)/'
	@echo 'make clean        remove all that the others made'

demo: $(VENV)/.installed
	rm -rf $(DEMO)
	mkdir $(DEMO)
	cd $(DEMO) && ../$(BIN)/jaxgear init accessory
	cd $(DEMO) && ../$(BIN)/jaxgear run accessory.toml
	cd $(DEMO) && ../$(BIN)/jaxgear map accessory.toml
	@pictures=$$(find $(DEMO_OUT) -name '*.png' | sort); \
	if [ -z "$$pictures" ]; then echo 'No picture in $(DEMO_OUT).' >&2; exit 1; fi; \
	printf '\nThe pictures:\n%s\n' "$$pictures"

# The cheapest check first.
test: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(MAKE) types suite

# As the Python that is used: the types of libraries for a newer one are not those for an older.
types: $(VENV)/.installed-dev
	$(BIN)/ty check --python $(VENV) --python-version \
	  "$$($(BIN)/python -c 'import sys; print("{}.{}".format(*sys.version_info))')"

# Tests of one file stay in one process: they share what JAX compiles. Whole commands come first,
# as the files are named, so that no process is left alone with them at the end.
suite: $(VENV)/.installed-dev
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

# As users compile: with the fast tests' older emitters some large programs find no contact.
test-slow: $(VENV)/.installed-dev $(VENV)/.installed-docs
	@$(call install,-e '.[browser]')
	XLA_FLAGS= $(BIN)/pytest -m slow

# Slow: every fault is a run of its own. One by one: `python tests/planted_faults.py --help`.
test-faults: $(VENV)/.installed-dev
	$(BIN)/python tests/planted_faults.py --jobs 2

# Numbers to 1e-12, texts and pictures to the character: for changes that should change nothing.
golden-check golden-record: $(VENV)/.installed-dev
	$(BIN)/python tests/golden $(@:golden-%=%)

bench: $(VENV)/.installed
	$(BIN)/python benchmarks/bench.py
	$(BIN)/python benchmarks/bench_bodies.py
	$(BIN)/python benchmarks/bench_hybrid.py
	$(BIN)/python benchmarks/bench_answers.py
	$(BIN)/python benchmarks/bench_face.py

measure: $(VENV)/.installed
	$(BIN)/python benchmarks/measure.py

# Strict: a warning, or a name that is nowhere, fails it.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -W -n --keep-going -b html docs $(SITE)

clean:
	rm -rf $(VENV) $(DEMO) $(SITE) jupyter_execute docs/_made results/bench build dist .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The environment is made anew when what it should hold has changed.
$(VENV)/.made: pyproject.toml constraints.txt
	@python=; lacking=; \
	for name in $(PYTHONS); do \
	  "$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || continue; \
	  if "$$name" -c 'import venv, ensurepip' 2>/dev/null; then python=$$name; break; fi; \
	  lacking=$$name; \
	done; \
	if [ -z "$$python$$lacking" ]; then \
	  echo 'jaxgear needs Python 3.11 or newer: $(PYTHONS) will not do. Install one, or name it:' >&2; \
	  echo 'make PYTHON=/path/to/python' >&2; \
	  exit 1; \
	fi; \
	if [ -z "$$python" ]; then \
	  echo "$$lacking cannot make a virtual environment: it lacks venv or ensurepip. On Debian and" >&2; \
	  echo "Ubuntu: apt install python3-venv. Or name another: make PYTHON=/path/to/python" >&2; \
	  exit 1; \
	fi; \
	echo "Making $(VENV) with $$("$$python" --version)"; \
	"$$python" -m venv --clear $(VENV)
	@touch $@

$(VENV)/.installed: $(VENV)/.made
	@$(call install,-e .)
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	@$(call install,-e '.[docs]')
	@touch $@

# All in one go: each asks anew what there is.
$(VENV)/.installed-dev: $(VENV)/.made
	@$(call install,-e '.[dev]')
	@touch $(VENV)/.installed $@
