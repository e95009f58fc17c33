PYTHON ?= .venv/bin/python

.PHONY: check test validate

check:
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m pyright --pythonpath $(PYTHON)

test:
	$(PYTHON) -m pytest -q -n 2

validate:
	$(PYTHON) -m mechsim.cli validate --report out/
