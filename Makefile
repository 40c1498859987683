# SPDX-License-Identifier: Apache-2.0
# The short way to Meson. Packages that are missing are installed by `deps`
# (Debian and its relatives; elsewhere see scripts/deps.sh for what is needed).

PREFIX  ?= /usr/local
DESTDIR ?=
BUILD   := build/release
SAMPLES ?= data
FUZZ_SECONDS ?= 120
JOBS ?= $(shell nproc)

.PHONY: all deps build demo capture-demo check check-slow bench install uninstall clean help

all: build

help:
	@echo 'make             build (into $(BUILD))'
	@echo 'make demo        install what is missing, build, restore the bracket in data/demo'
	@echo 'make capture-demo  the same, but for a bracket that a simulated camera shoots first'
	@echo 'make check       install what is missing, build twice (plain, sanitized), run all tests'
	@echo 'make check-slow  open reports in Chromium, fuzz with clang (installs both) for FUZZ_SECONDS=$(FUZZ_SECONDS) seconds a target'
	@echo 'make bench       quality on the brackets under SAMPLES=$(SAMPLES), time and memory at 12 megapixels'
	@echo 'make install     into PREFIX=$(PREFIX) (and DESTDIR)'
	@echo 'make clean       remove what was built'

deps:
	@scripts/deps.sh

$(BUILD)/build.ninja: meson.build meson_options.txt
	@if [ -f $@ ]; then meson setup --reconfigure $(BUILD) --prefix '$(PREFIX)'; \
	else meson setup $(BUILD) --prefix '$(PREFIX)'; fi

build: $(BUILD)/build.ninja
	@ninja -C $(BUILD) -j $(JOBS)

demo: deps
	@$(MAKE) --no-print-directory build
	@scripts/demo.sh $(BUILD)/src/cli/brace

capture-demo: deps
	@$(MAKE) --no-print-directory build
	@scripts/capture_demo.sh $(BUILD)/src/cli/brace

check: deps
	@scripts/check.sh

check-slow: deps
	@scripts/deps.sh slow
	@scripts/browser.sh
	@scripts/fuzz.sh $(FUZZ_SECONDS)

bench: deps
	@$(MAKE) --no-print-directory build
	@bench/run.sh $(BUILD) '$(SAMPLES)'

install: $(BUILD)/build.ninja
	@meson configure $(BUILD) --prefix '$(PREFIX)'
	@ninja -C $(BUILD) -j $(JOBS)
	@DESTDIR='$(DESTDIR)' meson install -C $(BUILD) --no-rebuild

uninstall:
	@DESTDIR='$(DESTDIR)' ninja -C $(BUILD) uninstall

clean:
	rm -rf build demo bench-out
