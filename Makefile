# Fresh machine, Python 3.11 or later: `make demo`, `make test` and `make check` set themselves up in .venv.
PYTHON ?= python3
BIN = .venv/bin
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check
JOBS ?= 2

.PHONY: demo test check lock clean

demo: .venv/user  ## a small benchmark; writes results/demo
	$(BIN)/vse-gym bench demo --jobs $(JOBS) --out results/demo --overwrite
	$(BIN)/vse-gym run sine_with_dwell --sensors loud --seed 3 --plot results/demo/drive.png

test: .venv/dev
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile -q

check: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# One environment; each stamp says what has been installed into it. constraints.txt pins what CI used.
.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/user: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) -c constraints.txt -e '.[report]'
	@touch $@

# torch by itself first: as a dependency of another package, pip would prefer a build with gigabytes of CUDA
.venv/dev: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) torch==2.13.0
	$(PIP) -c constraints.txt -e '.[dev]'
	@touch $@ .venv/user

lock: .venv/dev  ## after raising versions: write down what is installed
	$(BIN)/python -m pip freeze --exclude-editable | sed 's/+cpu//' > constraints.txt

clean:
	rm -rf .venv results build dist
