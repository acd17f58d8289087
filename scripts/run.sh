#!/usr/bin/env bash
# Starts the application, with a noisy sample in training unless something is named.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${VENV:-.venv}/bin
sample=$("$bin/python" -c 'from dmp.samples import sample; s = sample("bumpy-sphere"); print(s.mesh_path, s.ground_truth_path, sep="\n")')
noisy=$(head -n 1 <<< "$sample")
truth=$(tail -n 1 <<< "$sample")
if [ "$(uname -s)" = Linux ] && [ -z "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; then
    cat >&2 <<EOF
There is no display here, so the window cannot open. The same work from the command line:
    $bin/dmp denoise SCAN.ply -o CLEAN.ply
or with a sample:
    $bin/dmp denoise ${noisy#"$PWD/"} -o clean.ply --ground-truth ${truth#"$PWD/"}
EOF
    exit 1
fi
if [ $# -eq 0 ]; then
    set -- "$noisy" --ground-truth "$truth" --start
fi
exec "$bin/dmp-viewer" "$@"
