#!/usr/bin/env bash
# Creates the virtual environment and installs what is missing.
#   scripts/bootstrap.sh run    what the application needs
#   scripts/bootstrap.sh test   the same, and what the tests, the linters and a virtual screen need
# Nothing is done twice: a stamp in the environment remembers what was installed for which pyproject.toml.
set -euo pipefail
cd "$(dirname "$0")/.."
purpose=${1:-run}
venv=${VENV:-.venv}

say() { printf '%s\n' "$*" >&2; }

# Installs Debian packages where that is possible without a question, and otherwise tells the command to type.
install_packages() {
    local command="apt-get install -y --no-install-recommends $*"
    if ! command -v apt-get >/dev/null; then
        say "Please install these with your system's package manager (Debian names): $*"
        return 1
    fi
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        if command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
            as_root=(sudo)
        else
            say "Some system packages are missing. Please type this, then repeat your command:"
            say "    sudo $command"
            return 1
        fi
    fi
    say "Installing system packages: $*"
    if ! { ${as_root[@]+"${as_root[@]}"} apt-get update -qq && DEBIAN_FRONTEND=noninteractive ${as_root[@]+"${as_root[@]}"} $command -qq; } >/dev/null; then
        say "That failed. Please try it by hand, then repeat your command:"
        say "    sudo $command"
        return 1
    fi
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-} python3 python3.13 python3.12 python3.11; do
        if command -v "$candidate" >/dev/null && "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

if [ ! -x "$venv/bin/python" ]; then
    if ! python=$(find_python); then
        install_packages python3 python3-venv || true
        python=$(find_python) || { say "Python 3.11 or newer is needed, and none was found. Set PYTHON=/path/to/python3 if it is elsewhere."; exit 1; }
    fi
    if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
        install_packages "python$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv" || install_packages python3-venv || exit 1
    fi
    say "Creating the environment in $venv with $("$python" --version)."
    "$python" -m venv "$venv"
fi

extras=""
[ "$purpose" = test ] && extras="[dev]"
wanted="$purpose $(cksum < pyproject.toml) ${TORCH_INDEX:-}"
stamp="$venv/.installed-$purpose"
if [ "$(cat "$stamp" 2>/dev/null)" != "$wanted" ]; then
    say "Installing Python packages (about 1.7 GB with torch, VTK and Qt; some minutes the first time)."
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --upgrade pip >&2
    if [ -n "${TORCH_INDEX:-}" ]; then
        torch=$("$venv/bin/python" -c 'import tomllib; print(next(d for d in tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"] if d.startswith("torch")))')
        "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --index-url "$TORCH_INDEX" "$torch" >&2
    fi
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --editable ".$extras" >&2
    if [ "$purpose" = run ]; then
        # They would be compiled by the first training otherwise, which would wait for them.
        "$venv/bin/python" -m dmp.compiled >&2 || true
    fi
    printf '%s' "$wanted" > "$stamp"
fi

# What Qt's xcb plugin and VTK load when they start; wheels don't bring these.
if [ "$(uname -s)" = Linux ]; then
    missing=()
    libraries=$( (ldconfig -p || /sbin/ldconfig -p) 2>/dev/null | awk '{print $1}')
    while read -r library package; do
        grep -qxF "$library" <<< "$libraries" || missing+=("$package")
    done <<'EOF'
libGL.so.1 libgl1
libEGL.so.1 libegl1
libOpenGL.so.0 libopengl0
libGLX_mesa.so.0 libglx-mesa0
libEGL_mesa.so.0 libegl-mesa0
libX11.so.6 libx11-6
libX11-xcb.so.1 libx11-xcb1
libXrender.so.1 libxrender1
libXext.so.6 libxext6
libSM.so.6 libsm6
libICE.so.6 libice6
libxcb-cursor.so.0 libxcb-cursor0
libxcb-icccm.so.4 libxcb-icccm4
libxcb-image.so.0 libxcb-image0
libxcb-keysyms.so.1 libxcb-keysyms1
libxcb-randr.so.0 libxcb-randr0
libxcb-render.so.0 libxcb-render0
libxcb-render-util.so.0 libxcb-render-util0
libxcb-shape.so.0 libxcb-shape0
libxcb-shm.so.0 libxcb-shm0
libxcb-sync.so.1 libxcb-sync1
libxcb-util.so.1 libxcb-util1
libxcb-xfixes.so.0 libxcb-xfixes0
libxcb-xkb.so.1 libxcb-xkb1
libxkbcommon.so.0 libxkbcommon0
libxkbcommon-x11.so.0 libxkbcommon-x11-0
libfontconfig.so.1 libfontconfig1
libfreetype.so.6 libfreetype6
libdbus-1.so.3 libdbus-1-3
libglib-2.0.so.0 libglib2.0-0
libgomp.so.1 libgomp1
EOF
    # Without any font Qt draws empty boxes.
    if ! { command -v fc-list >/dev/null && [ -n "$(fc-list 2>/dev/null | head -n 1)" ]; } && ! ls /usr/share/fonts/*/* >/dev/null 2>&1; then
        missing+=(fonts-dejavu-core fontconfig)
    fi
    if [ "$purpose" = test ]; then
        command -v Xvfb >/dev/null || missing+=(xvfb)
    fi
    if [ ${#missing[@]} -gt 0 ]; then
        install_packages "${missing[@]}" || exit 1
    fi
fi
