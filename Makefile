# Needs Python 3.11 or newer, make and git; everything else is set up in .venv on the first call.
SHELL := /bin/bash
VENV ?= .venv
OPENCV ?= opencv-python-headless>=4.10,<6
STAMP := $(VENV)/.set-up
# The newest python3.N found, 3.11 or newer; `make PYTHON=...` overrides.
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3 python; do \
	"$$p" -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)
# Two cores are enough to keep busy; pytest-xdist spreads the files over them.
PYTEST := $(VENV)/bin/python -m pytest -n 2 --dist loadfile
# Of one long test.
SOAK_TIMEOUT_S ?= 7200

.PHONY: demo test soak lint set-up clean
.DEFAULT_GOAL := demo

demo: $(STAMP)
	$(VENV)/bin/rig demo

test: $(STAMP)
	$(PYTEST) -m "not soak" $(ARGS)

# The long tests, one at a time. pytest ends with 5 where none is selected: that is no failure.
soak: $(STAMP)
	$(VENV)/bin/python -m pytest -m soak --timeout $(SOAK_TIMEOUT_S) $(ARGS) || { code=$$?; test $$code -eq 5 && echo "no soak tests selected"; }

lint: $(STAMP)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

set-up: $(STAMP)

# Set up again only when what is asked for has changed.
$(STAMP): pyproject.toml
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed, and none was found. Install it, or give make PYTHON=/path/to/python3" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[all]' '$(OPENCV)'
	@touch $(STAMP)

clean:
	rm -rf $(VENV) .venv-cv4
