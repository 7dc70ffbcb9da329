#!/bin/sh
# Draws the pictures of README and docs again: a simulated drive, replayed; the pages in Chromium. Run from the clone's root; TPMSD
# names the program, PY the Python with the extras dev.
set -eu
tpmsd="${TPMSD:-.venv/bin/tpmsd}"
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$tpmsd" simulate "$folder/slow-puncture" --duration 600 --seed 1 --leak rl --at 300 --over 90 --loss-percent 0.7 --outage 420:450
"$tpmsd" replay "$folder/slow-puncture" --plot docs/images/slow-puncture.png
"$tpmsd" simulate "$folder/real" --duration 400 --seed 5 --effect centrifugal_growth:coefficient=2.1e-6 --effect gnss_latency:latency_s=0.15
"$tpmsd" diagnose "$folder/real" --certify 0 --model-out "$folder/model.toml" --plot docs/images/what-is-left-out.png
"${PY:-.venv/bin/python}" -m tests.browser.screenshots docs/images
