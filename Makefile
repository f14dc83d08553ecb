# Everything runs from a fresh clone: the first target that needs it sets up .venv, which needs
# Python 3.11 or newer and either uv or Python's own venv and pip.  What is installed are the versions
# of constraints.txt, so that a clone gives the same answers in a year.

SHELL := /bin/sh
# The virtual environment is up to date if this file is newer than pyproject.toml and constraints.txt.
READY := .venv/.installed
# So are the packages that only some targets need (see `optional-dependencies` there).
EXTRAS := .venv/.extras
EVERY := dev,notebook,pdf,cluster,store,grid,fmu,docs
# A python of your own choice: make test PYTHON=/path/to/python3.12
PYTHON ?=
# Programs that tests start hundreds of times find their modules compiled.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo test lint types slow evidence bench docs newest clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):[^#]*## \(.*\)/  make \1	\2/p' Makefile

demo: $(READY) ## certify the paper's example; writes the folder paper-fixed-certificate
	.venv/bin/dobc certify paper-fixed

test: $(READY) ## the fast tests, one to three minutes; ends with those over 2 s
	.venv/bin/python -m pytest -n 2 --dist worksteal --benchmark-disable --durations=0 --durations-min=2

lint: $(READY) ## style and format of the code
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .

types: $(READY) ## types of the code
	.venv/bin/mypy

slow: $(READY) ## the slow tests, several minutes
	.venv/bin/python -m pytest -n 2 --dist worksteal --benchmark-disable -m "slow and not evidence"

newest: $(READY) ## fast tests, where newer packages are out than are pinned
	.venv/bin/python .ci/matrix.py newest

evidence: $(READY) ## the full counts, many minutes; prints one table
	.venv/bin/python tests/evidence/run.py

bench: $(READY) ## the table of speed and memory
	.venv/bin/python tests/benchmarks/run.py

docs: $(EXTRAS) ## the handbook: docs/_build/html/index.html, up to four minutes; runs notebooks that changed
	.venv/bin/sphinx-build -W --keep-going -j auto -b html docs docs/_build/html

clean: ## remove what the other targets leave behind, but not .venv
	rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	rm -rf .coverage .coverage.* htmlcov paper-fixed-certificate docs/_build
	find dobc_design tests notebooks -name __pycache__ -type d -prune -exec rm -rf {} +

# The tested set, built without a download of build tools beside it.
define install
	wanted='$(1)'; \
	if command -v uv >/dev/null 2>&1; then \
	  into='uv pip install --python .venv/bin/python'; \
	else \
	  into='.venv/bin/python -m pip install --quiet --disable-pip-version-check'; \
	fi; \
	$$into --constraint constraints.txt setuptools; \
	$$into --constraint constraints.txt --no-build-isolation --editable "$$wanted"
endef

# One shell, so that a failing line leaves no stamp. A .venv that cannot run (half made, too old)
# is made anew; one that runs is kept and brought up to date.
$(READY): pyproject.toml constraints.txt
	@set -e; \
	new_enough='import sys; sys.exit(sys.version_info < (3, 11))'; \
	python=; bare=; \
	for candidate in $(PYTHON) python3.13 python3.12 python3.11 python3; do \
	  "$$candidate" -c "$$new_enough" >/dev/null 2>&1 || continue; \
	  bare=$${bare:-$$candidate}; \
	  if "$$candidate" -c 'import ensurepip, venv' >/dev/null 2>&1; then python=$$candidate; break; fi; \
	done; \
	echo "Setting up .venv: about 100 packages, 1.2 GB on the disk; the first time takes one to three minutes."; \
	if command -v uv >/dev/null 2>&1; then \
	  .venv/bin/python -c "$$new_enough" >/dev/null 2>&1 \
	    || { rm -rf .venv; uv venv --python "$${python:-$${bare:-3.11}}" .venv; }; \
	elif ! .venv/bin/python -c "import pip; $$new_enough" >/dev/null 2>&1; then \
	  if test -z "$$bare"; then \
	    echo "dobc_design needs Python 3.11 or newer, and python3.13, python3.12, python3.11 and python3 are" \
	      "missing or older. Install one, or name it: make PYTHON=/path/to/python" >&2; exit 1; \
	  fi; \
	  if test -z "$$python"; then \
	    echo "dobc_design needs python3-venv or uv: $$bare cannot make virtual environments (it has no" \
	      "ensurepip). On Debian or Ubuntu: sudo apt install python3-venv" >&2; exit 1; \
	  fi; \
	  "$$python" -m venv --clear .venv; \
	fi; \
	$(call install,.[dev]); \
	touch $(READY)

$(EXTRAS): $(READY)
	@set -e; \
	echo "Adding the packages for notebooks, reports and the handbook to .venv; this takes a minute or two."; \
	$(call install,.[$(EVERY)]); \
	touch $(EXTRAS)
