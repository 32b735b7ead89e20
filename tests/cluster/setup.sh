#!/usr/bin/env bash
# Snakemake and its Slurm executor, in an environment of their own.
set -euo pipefail
cd "$(dirname "$0")"
python3 -m venv .venv
.venv/bin/pip install -q -r requirements.txt snakemake-executor-plugin-slurm==2.8.0
.venv/bin/snakemake --version
