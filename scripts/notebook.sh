#!/usr/bin/env bash
# Executes the notebook on the recorded run, in a separate Python environment in target/notebook. The environment is created if it does not exist, and
# created again if the list of packages has changed.
set -euo pipefail
root="$(cd "$(dirname "$0")/.." && pwd)"
"$root/scripts/environment.sh" notebook "$root/target/notebook" "$root/notebooks-data/requirements.txt"
exec "$root/target/notebook/bin/python" "$root/scripts/notebook.py" "$root/notebooks-data/headline.ipynb" "$@"
