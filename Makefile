# The two main commands: `make demo` shows what Scree does, and `make test` checks it. Both run `make setup` first.
#
# Everything is built with --release into one target folder, except the mutants of `make mutants-rust` and the fuzz targets. Without optimisation, the
# references, the world and the software rasteriser are too slow. A second profile would compile every dependency twice.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

CARGO ?= cargo
# Folder for the demo's results. To change it: `make demo OUT=somewhere/else`.
OUT ?= out/demo
# Seconds that `make fuzz` spends on each target.
FUZZ_SECONDS ?= 60
FUZZ_TARGETS := scene definition heightmap material openexr texture cache
# Version of cargo-mutants, which lists the mutants of the Rust code. It is installed into target/tools, so a version that the user has installed is
# not changed.
CARGO_MUTANTS := 27.1.0

# Mesa's drivers print a warning if XDG_RUNTIME_DIR is not set, so it is set to a private folder.
ifeq ($(strip $(XDG_RUNTIME_DIR)),)
export XDG_RUNTIME_DIR := $(shell dir="$${TMPDIR:-/tmp}/scree-runtime-$$(id -u)"; mkdir -p -m 700 "$$dir"; \
    if [ -O "$$dir" ]; then echo "$$dir"; else mktemp -d; fi)
endif

.PHONY: help setup demo app test mutants mutants-rust bench judges fuzz audit clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## checks for cargo and a Vulkan driver; installs Mesa's software driver on Debian and Ubuntu if there is none (Debian 12: from backports)
	@scripts/setup.sh

demo: setup ## runs a small experiment on the built-in world; writes a report
	$(CARGO) build --release --locked -p experiments
	$(CARGO) run --release --locked -q -p experiments -- demo --out "$(OUT)"
	@echo "The report is $(OUT)/report.html"

app: setup ## opens the workbench; edited shaders are reloaded at once
	$(CARGO) build --release --locked -p experiments
	$(CARGO) run --release --locked -p workbench -- --shaders kernels/src

test mutants mutants-rust: export RUSTC_WORKSPACE_WRAPPER = $(CURDIR)/scripts/lints.sh
test: setup ## format, lints, documentation, every test, the notebook
	@scripts/test_setup.sh
	$(CARGO) fmt --all --check
# The whole workspace is built, like in the next step. If a single program were built, its libraries would have different features, so cargo would
# compile them twice.
	$(CARGO) build --release --locked --workspace --all-targets
	$(CARGO) test --release --locked --workspace
	@scripts/notebook.sh
	@if [ -z "$${SCREE_DATA:-}" ]; then echo "Skipped, because SCREE_DATA is not set: the tests on real elevation and real materials."; fi

mutants: setup ## plants SAMPLE faults (default 100) in the shaders of STAGE (several stages: a,b), and lists the faults that no test notices
	$(CARGO) build --release --locked --workspace --all-targets
	$(CARGO) test --release --locked --workspace --test mutants -- --stage "$(or $(STAGE),$(error give STAGE, such as STAGE=lighting))" \
	    --sample "$(or $(SAMPLE),100)" --seed "$(or $(SEED),1)" $(if $(ALL),--all) $(if $(RECORD),--record "$(RECORD)" --date "$$(date +%F)")

mutants-rust: setup ## plants SAMPLE faults (default 100) in the Rust references (or in FILE, such as shared/noise.rs; several: a,b), and lists those that no test notices
	@[ "$$(target/tools/bin/cargo-mutants mutants --version 2>/dev/null)" = "cargo-mutants $(CARGO_MUTANTS)" ] || \
	    env -u RUSTC_WORKSPACE_WRAPPER $(CARGO) install --locked --root target/tools --version $(CARGO_MUTANTS) cargo-mutants
	$(CARGO) test --release --locked --workspace --test mutants -- --rust "$(or $(FILE),references)" \
	    --sample "$(or $(SAMPLE),100)" --seed "$(or $(SEED),1)" $(if $(AGAIN),--again) $(if $(RECORD),--record "$(RECORD)" --date "$$(date +%F)")

bench: setup ## times the passes and prints their ratios
	$(CARGO) run --release --locked -p experiments -- bench

judges: setup ## shows clips to ColorVideoVDP and compares perceived noise with its verdicts; installs 6 GB in .judges
	$(CARGO) build --release --locked -p experiments
	@scripts/judges/judges.sh target/release/experiments out/judges

# The copied lock file gives the fuzz targets the same versions of dependencies as the workspace. New inputs are written to out/fuzz, so that the
# corpus in fuzz/corpus does not change. Inputs that cause a crash are written to fuzz/artifacts.
fuzz: ## feeds arbitrary bytes to every file reader, for FUZZ_SECONDS each; needs cargo-fuzz and a nightly compiler
	cp Cargo.lock fuzz/Cargo.lock
	for target in $(FUZZ_TARGETS); do \
	    mkdir -p out/fuzz/$$target; \
	    $(CARGO) +nightly fuzz run $$target out/fuzz/$$target fuzz/corpus/$$target -- -max_total_time=$(FUZZ_SECONDS) -timeout=20 -rss_limit_mb=4096; \
	done

audit: ## licences, advisories, spelling; needs cargo-deny and typos
	$(CARGO) deny check
	typos

clean: ## removes build output, results in out, and the environment of the judges
	$(CARGO) clean
	rm -rf out fuzz/target .judges
