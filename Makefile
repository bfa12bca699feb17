# Two virtual environments, made on demand: .venv to use the filters, .venv-dev to work on them.
PYTHON ?= python3
MESH ?=
OUT ?= out
ARGS ?=
DIR ?=
MODELS ?=
PYTHONS ?= python3.10 python3.13
WHEEL_PYTHONS ?= python3.10 python3.11 python3.12 python3.13 python3.14
EXTRAS := viz,convert,scale
SOURCES := pyproject.toml
BIN := $(if $(filter Windows_NT,$(OS)),Scripts,bin)

.PHONY: help demo test test-slow test-oldest test-next test-pythons frozen style check coverage docs wheel bench paper bench-kernels bench-scale \
    fuzz mutants corpus hosts clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 16

demo: .venv/ready  ## curvature, torsion and normals of the bunny (or MESH=file) into out/
	.venv/$(BIN)/bezier-filters demo $(if $(MESH),'$(MESH)') --out '$(OUT)'

test: .venv-dev/ready  ## run the test suite, in two processes
	.venv-dev/$(BIN)/python -m pytest -n 2 --dist worksteal $(ARGS)

test-slow: .venv-dev/ready  ## run the tests that take long
	.venv-dev/$(BIN)/python -m pytest -m slow $(ARGS)

test-oldest: $(SOURCES)  ## run the test suite with the oldest versions of the dependencies that are allowed
	$(PYTHON) -m venv --clear .venv-oldest
	$(PYTHON) tests/oldest_versions.py > .venv-oldest/constraints.txt
	.venv-oldest/$(BIN)/python -m pip install --quiet --upgrade pip
	.venv-oldest/$(BIN)/python -m pip install --quiet -e '.[$(EXTRAS)]' --group test -c .venv-oldest/constraints.txt
	.venv-oldest/$(BIN)/python -m pytest -W ignore::DeprecationWarning $(ARGS)

test-next: $(SOURCES)  ## run the tests of compiled code with the newest numba, release candidates and versions above our bound included
	$(PYTHON) -m venv --clear .venv-next
	.venv-next/$(BIN)/python -m pip install --quiet --upgrade pip
	.venv-next/$(BIN)/python -m pip install --quiet -e '.[scale]' --group test
	.venv-next/$(BIN)/python -m pip install --quiet --upgrade --pre numba llvmlite
	.venv-next/$(BIN)/python -m pytest -m "slow or not slow" tests/runtime tests/kernels tests/fitting $(ARGS)

test-pythons: $(SOURCES)  ## run the test suite on other Pythons: PYTHONS="python3.10 python3.13"
	set -e; for python in $(PYTHONS); do \
	    env=.venv-python$$($$python -c 'import sys; print("%d.%d" % sys.version_info[:2])'); \
	    $$python -m venv --clear $$env; \
	    $$env/$(BIN)/python -m pip install --quiet --upgrade pip; \
	    $$env/$(BIN)/python -m pip install --quiet -e '.[$(EXTRAS)]' --group test; \
	    $$env/$(BIN)/python -m pytest $(ARGS); \
	done

frozen: .venv-dev/ready  ## compare every array of the public functions with the hashes in tests/frozen.json
	.venv-dev/$(BIN)/python tests/frozen.py $(ARGS)

style: .venv-dev/ready  ## style (ruff)
	.venv-dev/$(BIN)/ruff check .
	.venv-dev/$(BIN)/ruff format --check .

check: style  ## style and types (mypy)
	.venv-dev/$(BIN)/mypy

coverage: .venv-dev/ready  ## lines and branches that the tests run, kernels in plain Python (takes some minutes)
	.venv-dev/$(BIN)/coverage erase
	.venv-dev/$(BIN)/coverage run -m pytest -q
	NUMBA_DISABLE_JIT=1 .venv-dev/$(BIN)/coverage run -m pytest -q tests/whole/test_plain_python.py
	.venv-dev/$(BIN)/coverage combine
	.venv-dev/$(BIN)/coverage report

docs: .venv-dev/docs-ready  ## the documentation site in build/site; warnings are errors
	NO_MKDOCS_2_WARNING=1 .venv-dev/$(BIN)/mkdocs build --strict

wheel: .venv-dev/ready  ## sdist and wheels in dist/, one with machine code for each Python that is there, checked and tried
	.venv-dev/$(BIN)/python -m pip install --quiet --group release
	rm -rf dist
	.venv-dev/$(BIN)/python -m build
	set -e; for python in $(WHEEL_PYTHONS); do \
	    $$python -c '' 2>/dev/null || { echo "$$python is not there: no wheel for it"; continue; }; \
	    $$python -m venv --clear build/wheel-python; \
	    build/wheel-python/$(BIN)/python -m pip install --quiet build; \
	    HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 build/wheel-python/$(BIN)/python -m build --wheel; \
	done
	.venv-dev/$(BIN)/twine check --strict dist/*
	.venv-dev/$(BIN)/check-wheel-contents dist/*.whl
	.venv-dev/$(BIN)/pyroma --min 10 .
	.venv-dev/$(BIN)/python -m pytest -m "slow or not slow" tests/project/test_packaging.py

bench: .venv-dev/bench-ready  ## accuracy, stability and speed next to MeshLab and libigl; ARGS=--save keeps it
	.venv-dev/$(BIN)/python benchmarks/accuracy.py $(ARGS)
	.venv-dev/$(BIN)/python benchmarks/reduction.py --slow $(ARGS)
	.venv-dev/$(BIN)/python benchmarks/red_blood_cell.py $(ARGS)
	.venv-dev/$(BIN)/python benchmarks/uneven_shape.py $(ARGS)
	.venv-dev/$(BIN)/python benchmarks/holes.py $(ARGS)
	.venv-dev/$(BIN)/python benchmarks/speed.py $(ARGS)

bench-scale: .venv-dev/ready  ## 50 million vertices in tiles, next to smaller meshes in memory (30 GB of disk)
	.venv-dev/$(BIN)/python benchmarks/scale.py --vertices 1000000 7000000 50000000 --save benchmarks/results/scale.json
	.venv-dev/$(BIN)/python benchmarks/scale.py --smooth --save benchmarks/results/scale_smoothing.json

paper: .venv-dev/ready  ## the paper's figures and tables on one page, in build/paper; MODELS=folder has fandisk, dragon, bunny
	.venv-dev/$(BIN)/python benchmarks/paper_figures.py $(if $(MODELS),--models '$(MODELS)') $(ARGS)

bench-kernels: .venv-dev/bench-ready  ## times of the stages, next to the last run of this target
	.venv-dev/$(BIN)/python -m pytest -q -W default benchmarks/bench_kernels.py --benchmark-autosave --benchmark-compare \
	    --benchmark-columns=min,median --benchmark-sort=name

fuzz: .venv-dev/ready  ## damage 100,000 meshes, 10,000 files and 300 stores and caches at random, and run on them
	.venv-dev/$(BIN)/python tools/fuzz.py
	.venv-dev/$(BIN)/python tools/fuzz_files.py
	.venv-dev/$(BIN)/python tools/fuzz_stored.py

mutants: .venv-dev/bench-ready  ## change the code at 250 places, one at a time: do the tests notice? ARGS="--first 500" goes on
	.venv-dev/$(BIN)/python tools/mutants.py $(if $(ARGS),$(ARGS),--first 250)

corpus: .venv-dev/ready  ## run everything on every mesh file below a folder (DIR=folder), into out/corpus.csv
	.venv-dev/$(BIN)/python tools/corpus.py $(DIR) $(ARGS)

hosts: .venv-dev/ready  ## install PyVista, napari, Blender and the adapters, and take first pictures of MESH=file.obj; needs ParaView and xvfb
	.venv-dev/$(BIN)/python tools/host_pictures.py '$(MESH)' $(ARGS)

clean:  ## remove environments, caches and outputs
	rm -rf .venv .venv-dev .venv-oldest .venv-next .venv-python* out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

.venv/ready: $(SOURCES)
	$(PYTHON) -m venv .venv
	.venv/$(BIN)/python -m pip install --quiet --upgrade pip
	.venv/$(BIN)/python -m pip install --quiet -e '.[viz]'
	@touch $@

.venv-dev/ready: $(SOURCES)
	$(PYTHON) -m venv .venv-dev
	.venv-dev/$(BIN)/python -m pip install --quiet --upgrade pip
	.venv-dev/$(BIN)/python -m pip install --quiet -e '.[$(EXTRAS)]' --group dev
	@touch $@

.venv-dev/docs-ready: .venv-dev/ready
	.venv-dev/$(BIN)/python -m pip install --quiet --group docs
	@touch $@

.venv-dev/bench-ready: .venv-dev/ready
	.venv-dev/$(BIN)/python -m pip install --quiet --group bench
	@touch $@
