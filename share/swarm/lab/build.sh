#!/usr/bin/env bash
# Builds the image of the lab's nodes from this checkout: share/swarm/lab/build.sh [IMAGE]
# SWARM_BASE: another base than debian:12-slim. PYTHON: the python3 whose pip fetches the wheels; else that of .venv.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
image=${1:-swarmware-lab}
context=$(mktemp -d)
trap 'rm -rf "$context"' EXIT

python=${PYTHON:-$root/.venv/bin/python}
[ -n "${PYTHON:-}" ] || [ -x "$python" ] || make --silent --directory "$root" .venv/bin/python

echo "fetching wheels"
"$python" -m pip wheel --quiet --disable-pip-version-check --wheel-dir "$context/wheels" "$root[mongo]"
cp "$here/Dockerfile" "$context/"
echo "building $image"
docker build --quiet --build-arg "BASE=${SWARM_BASE:-debian:12-slim}" --tag "$image" "$context"
