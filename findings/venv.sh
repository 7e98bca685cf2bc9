# SPDX-License-Identifier: BSD-3-Clause
# Sourced by the scripts beside it with a list of pinned packages: they are installed from PyPI into a virtual environment in
# a temporary folder, which becomes the working directory and is removed at the end. PYTHON names another interpreter.
set -euo pipefail
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
"${PYTHON:-python3}" -m venv --without-pip "$here/venv"
"${PYTHON:-python3}" -m pip --python "$here/venv/bin/python" install --quiet --no-compile --disable-pip-version-check \
   --root-user-action=ignore "$@"
PATH=$here/venv/bin:$PATH
export LD_LIBRARY_PATH="$here/venv/lib"
cd "$here"
