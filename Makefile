# make plan    plans across a rubble corridor and across the DARPA rubble mesh, verifies both and writes playback pages
# make test    compiles all kernels, then runs the tests (no torch), two at a time (JOBS=2);  make test-train  installs torch and runs what is marked train
# make docs    builds the documentation site into build/site (NOTEBOOKS=1 runs the tutorials first);  make gallery  its pages;  make figures  its figures
# make lint    ruff and pyright;  make bench  the tables of docs/benchmarks.md;  make clean  forgets the environment
# Every target makes .venv when it is missing. PYTHON picks the interpreter (3.11 or newer).

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
OUT ?= out
JOBS ?= 2
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export DRAKE_DEPRECATION_RUNTIME_SEVERITY ?= error

.PHONY: plan test test-train lint bench picture docs notebooks gallery figures clean

plan: .venv/.plan
	@mkdir -p $(OUT)
	$(BIN)/drakeplan plan rubble_corridor --out $(OUT)/rubble_corridor.h5 --html $(OUT)/rubble_corridor.html
	$(BIN)/drakeplan plan hpp/darpa --start -3.6 0 0 --goal 3.9 0 --out $(OUT)/darpa.h5 --html $(OUT)/darpa.html

test: .venv/.dev
	$(BIN)/drakeplan warm-up
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile -m "not train"

test-train: .venv/.train
	$(BIN)/python -m pytest -m train

lint: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

bench: .venv/.dev
	$(BIN)/drakeplan bench

picture: .venv/.dev
	$(BIN)/python docs/make_picture.py

docs: .venv/.dev $(if $(NOTEBOOKS),notebooks)
	$(BIN)/python docs/make_gallery.py --first
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

notebooks: $(patsubst tutorials/%,build/notebooks/%,$(wildcard tutorials/*.ipynb))

build/notebooks/%.ipynb: tutorials/%.ipynb | .venv/.train
	$(BIN)/python -m nbconvert --to notebook --execute --output-dir $(@D) $<

gallery: .venv/.dev
	$(BIN)/python docs/make_gallery.py

figures: .venv/.dev
	$(BIN)/python docs/make_figures.py

clean:
	rm -rf .venv out .pytest_cache .ruff_cache build *.egg-info
	find . -name "*.nb[ic]" -delete

.venv/.made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "drakeplan needs Python 3.11 or newer: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv .venv || { echo "python3 -m venv failed: on Debian, apt-get install python3-venv"; exit 1; }
	@touch $@

# The meshes of hpp-environments alone, without the robots that it declares (5 MB instead of 140 MB).
.venv/.plan: .venv/.made pyproject.toml constraints.txt
	$(PIP) -e '.[fast]'
	$(PIP) --no-deps hpp-environments
	@touch $@

.venv/.dev: .venv/.plan
	$(PIP) -e '.[fast,robots,mip,cluster,peers,export,dev,docs]'
	@touch $@

.venv/.train: .venv/.dev
	$(PIP) -e '.[fast,robots,mip,cluster,peers,export,dev,docs,train]'
	@touch $@
