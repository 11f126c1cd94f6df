# Everything below needs only Python >= 3.11 with its venv module, make and git.
#   make report   the whole campaign on the simulated bench, then the report (in report/)
#   make test     the tests: every effect, plan, bench, command and page at least once
#   make test-all all tests; required after a change of diagnosis, effects or challenge
#   make coverage which lines and branches the tests run (in build/coverage, as text and as pages)
#   make check    formatting, lint, types, import contracts and pins
#   make format   rewrite the sources in the one format
#   make docs     the documents as a site (in build/docs), warnings as errors
#   make release  wheel, source archive and bill of materials (in dist/), each archive tried in an empty environment
#   make lock     pin all dependencies anew, with digests (requirements*.txt, constraints*.txt)
#   make picture  the picture of the README, from the tutorial's diagnosis
#   make notebook run the example notebook, and keep its results in it
#   make help     set up, and show this list
#   make clean    remove what the targets above have made
PYTHON ?= python3
VENV   ?= .venv
OUT    ?= report
BIN    := $(VENV)/bin

# The set-up is done again only when the contents of these two files change, whatever their dates say.
STAMP  := $(VENV)/.mccd-$(shell cat pyproject.toml requirements.txt | cksum | cut -d ' ' -f 1)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
# One thread per process in the linear algebra: the tests already use one process per core.
export OMP_NUM_THREADS      ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: report picture notebook test test-all coverage durations check check-format check-lint check-types check-imports check-lock format docs release help lock clean
.DELETE_ON_ERROR:

report: $(STAMP)
	$(BIN)/mccd report --out $(OUT)

# the tutorial's diagnosis, which ends with 1; with a white ground, for readers whose pages are dark
picture: $(STAMP)
	rm -rf build/picture && mkdir -p build/picture
	$(BIN)/mccd simulate --model docs/examples/mystery.toml --plan freerun --set "axes=['theta_x']" --set steps_s=1 \
	  --set noise_s=1 --set held_out_s=0.5 --out build/picture/record.h5
	$(BIN)/mccd diagnose build/picture/record.h5 --model docs/examples/nominal.toml --out build/picture/diagnosis || test $$? = 1
	sed '0,/<defs>/s//<rect width="100%" height="100%" fill="white"\/>&/' build/picture/diagnosis/figures/mechanism.svg > docs/images/diagnosis.svg

# the example notebook with what it prints and draws
notebook: $(STAMP)
	$(BIN)/python -m tests.docs.notebook

# A file or, where a file takes long, a test goes to the next free worker, the longest first (tests/order.py).
# Python and pytest keep what they have compiled: each of hundreds of processes would compile it all again.
TESTS := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist loadscope

test: $(STAMP)
	$(TESTS) $(ARGS)

test-all: $(STAMP)
	$(TESTS) -m "not soak" $(ARGS)

# The same tests, with what they run counted, in processes that they start too; they take longer.
coverage: $(STAMP)
	mkdir -p build/coverage
	$(TESTS) --cov --cov-report=term --cov-report=html:build/coverage/pages $(ARGS)

# what every test takes, by which the next runs are ordered
durations: $(STAMP)
	$(TESTS) -m "not soak" --write-durations $(ARGS)

check: check-format check-lint check-types check-imports check-lock

check-format: $(STAMP)
	$(BIN)/ruff format --quiet --check .

check-lint: $(STAMP)
	$(BIN)/ruff check .

check-types: $(STAMP)
	$(BIN)/mypy

check-imports: $(STAMP)
	$(BIN)/lint-imports

check-lock: $(STAMP)
	$(BIN)/python release/lock.py --check

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

docs: $(STAMP)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs

# each archive in an environment of its own that holds nothing else
release: $(STAMP)
	rm -rf dist
	$(BIN)/python -m build --outdir dist
	for archive in dist/*; do \
	  $(PYTHON) -m venv --clear build/release && \
	  build/release/bin/python -m pip install --quiet --require-hashes -r requirements-run.txt && \
	  build/release/bin/python -m pip install --quiet --no-deps --no-build-isolation "$$archive" && \
	  build/release/bin/mccd --version && \
	  (cd build/release && bin/mccd campaign run quick --out try/quick && bin/mccd log verify try/quick/*.h5) || exit 1; \
	done
	$(BIN)/python release/bill.py dist
	ls dist

help: $(STAMP)
	@sed -n 's/^#   make/make/p' Makefile

$(STAMP): $(BIN)/python
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.txt
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	rm -f $(VENV)/.mccd-*
	touch $@

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "mccd needs Python 3.11 or newer; $(PYTHON) is older or absent: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)

lock: $(STAMP)
	$(BIN)/python release/lock.py

clean:
	rm -rf $(VENV) $(OUT) build *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache
