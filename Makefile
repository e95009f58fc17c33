PYTHON ?= .venv/bin/python

.PHONY: check test test-long test-browser test-repository test-all validate docs three

check:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m pyright --pythonpath $(PYTHON)
	$(PYTHON) -m mypy --warn-unused-ignores --cache-dir /dev/null tests/repository/typed_use.py

test:
	$(PYTHON) -m pytest -q -n 2 --dist worksteal

# the tests that take 0.6 s and more, over half of the time of all
test-long:
	$(PYTHON) -m pytest -q -n 2 --dist worksteal -m 'long and not slow and not browser'

# what the repository says of itself: imports, names, links, README's commands, examples
test-repository:
	$(PYTHON) -m pytest -q -n 2 --dist worksteal tests/repository tests/validation

# long physics and full grids too
test-browser:
	$(PYTHON) -m pytest -q -n 2 --dist worksteal -m 'browser and not slow' tests/pictures tests/report

test-all:
	$(PYTHON) -m pytest -q -n 2 --dist worksteal -m '' -o 'norecursedirs=.*'

validate:
	$(PYTHON) -m mechsim validate --report out/

# pages in out/docs; every page's code runs, and a warning is an error
docs:
	$(PYTHON) -m sphinx -W --keep-going -q -j 4 -b html docs out/docs

# three.js with what the pages use of it, from npm: its version and that of the bundler are stated here
three:
	set -e; folder=$$(mktemp -d); view=$$PWD/mechsim/pictures/view/three; cp "$$view/three.entry.js" "$$folder"; cd "$$folder"; \
	npm install --silent three@0.187.0 esbuild@0.28.2; cp node_modules/three/LICENSE "$$view"; \
	npx esbuild three.entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 --outfile="$$view/three.min.js"
