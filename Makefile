# The two commands a newcomer needs: `make run` and `make test`. Both create the environment and install what is missing.
#   make run ARGS="my.ply"       open a file instead of the sample
#   make run TORCH_INDEX=URL     take torch from another package index (README, "Which torch")
VENV ?= .venv
BIN := $(VENV)/bin
export VENV

.DEFAULT_GOAL := help
.PHONY: help run test lint format wheel samples benchmark soak clean

help:  ## say what can be made
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

run:  ## start the application with a sample in training, or with ARGS="FILE …"
	@scripts/bootstrap.sh run
	@scripts/run.sh $(ARGS)

test:  ## run all tests, also without a display
	@scripts/bootstrap.sh test
	$(BIN)/python -m pytest $(ARGS)

lint:  ## check format, style, types and the direction of imports
	@scripts/bootstrap.sh test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format:  ## format the code
	@scripts/bootstrap.sh test
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

wheel:  ## build the wheel into dist/
	@scripts/bootstrap.sh test
	$(BIN)/python -m build --wheel

samples:  ## generate the sample meshes in assets/ anew
	@scripts/bootstrap.sh run
	$(BIN)/python -m dmp.samples

benchmark:  ## seconds per training step beside torch_geometric
	@scripts/bootstrap.sh test
	$(BIN)/dmp benchmark $(ARGS)

soak:  ## run the endurance checks at full size, for hours
	@scripts/bootstrap.sh test
	$(BIN)/python -m tests.soak $(ARGS)

clean:  ## remove what was built, the environment included
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache
