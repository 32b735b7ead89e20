#!/usr/bin/env bash
# Makes a virtual environment beside this script with the programs that the checks here compare against.
#   tests/peers/setup.sh && tests/peers/.venv/bin/python tests/peers/body_pinocchio.py
set -euo pipefail
cd "$(dirname "$0")"
python3 -m venv .venv
.venv/bin/pip install --quiet numpy scipy pin==4.1.0 mujoco==4.0.0 ezc3d==1.7.2 c3d==0.6.0 opensim==4.6 pandas polars pyarrow pysindy==2.1.0 pyoperon==0.6.2
.venv/bin/python -c 'import numpy, scipy, pinocchio, mujoco, ezc3d, c3d, opensim, pandas, polars, pysindy, pyoperon; print("ready")'
