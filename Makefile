# make demo, make test: all set-up is done on the way. FENICSX_SUITE=unstable and FENICSX_WHEELS=1
# pick another dolfinx.
FENICSX = scripts/fenicsx
PYTEST = python3 -m pytest
RANKS ?= $(shell test "$$(nproc 2>/dev/null || echo 1)" = 1 && echo 1 || echo 2)
export FENICSX_GROUPS = all

.PHONY: demo test quick fuzz forms lint docs pictures env

demo: export FENICSX_GROUPS = run
demo:
	$(FENICSX) mpirun -n $(RANKS) python3 demos/bend.py --coarse --output output/bend --overwrite

test: forms
	$(FENICSX) env OMP_NUM_THREADS=1 $(PYTEST) -q -n 2 --dist loadfile --no-loadscope-reorder
	$(FENICSX) mpirun -n 2 $(PYTEST) -q --color=no

# Contracts, and the tests of the folders that changed, without those marked slow.
quick: forms
	$(FENICSX) env PYTHONPATH=.:tests OMP_NUM_THREADS=1 python3 -m kit.quick

# Damaged files for all readers, from a fresh seed, for so many seconds.
SECONDS ?= 300
fuzz:
	$(FENICSX) env PYTHONPATH=.:tests OMP_NUM_THREADS=1 python3 -m kit.fuzz $(SECONDS)

forms:
	$(FENICSX) env PYTHONPATH=.:tests OMP_NUM_THREADS=1 python3 -m kit.warm

lint:
	$(FENICSX) python3 -m ruff check .
	$(FENICSX) python3 -m ruff format --check .
	rm -rf build/typed && mkdir -p build/typed
	cp -r toros_fem tests demos benchmarks build/typed
	cp -r forms meshes build/typed/toros_fem # as installed: mypy does not follow __path__
	cd build/typed && "$(CURDIR)/$(FENICSX)" python3 -m mypy --config-file "$(CURDIR)/pyproject.toml" \
		--cache-dir "$(CURDIR)/.mypy_cache" -p toros_fem
	cd build/typed && "$(CURDIR)/$(FENICSX)" env MYPYPATH=.:tests python3 -m mypy \
		--config-file "$(CURDIR)/pyproject.toml" --cache-dir "$(CURDIR)/.mypy_cache" --no-strict-optional demos tests

docs:
	$(FENICSX) python3 -m sphinx -q --fresh-env --fail-on-warning --keep-going -d build/doctrees docs build/docs
	@echo "the site is in build/docs: open build/docs/index.html"

# All pictures of README, demos and docs, from the coarse scenes: about 45 minutes of one core.
pictures:
	$(FENICSX) env OMP_NUM_THREADS=1 python3 -m benchmarks figures --only coarse --rows output/figures.csv
	$(FENICSX) python3 -m benchmarks figures --rows output/figures.csv --page
	$(FENICSX) env OMP_NUM_THREADS=1 python3 demos/three_field.py --coarse --overwrite
	$(FENICSX) python3 docs/copy_pictures.py
	$(FENICSX) python3 docs/make_gallery.py
	$(FENICSX) env OMP_NUM_THREADS=1 python3 docs/run_notebook.py
	$(FENICSX) env OMP_NUM_THREADS=1 python3 docs/draw_pictures.py

env:
	$(FENICSX)
