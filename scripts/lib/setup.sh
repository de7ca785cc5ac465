# Sourced by scripts/demo and scripts/test: makes .venv and the GL libraries stand, in seconds where they already do.
#
# setup EXTRAS    EXTRAS is what pip gets after the project's name, for instance "" or "[simulate,dev]".

say() { if [ -t 2 ]; then printf '\033[1m%s\033[0m\n' "$*" >&2; else printf '%s\n' "$*" >&2; fi; }
die() { printf 'error: %s\n' "$*" >&2; exit 1; }

# The command prefix that may install system packages: "" for root, "sudo -n" where sudo asks for no password, else none.
install_prefix() {
  if [ "$(id -u)" = 0 ]; then echo "env"; elif sudo -n true 2>/dev/null; then echo "sudo -n env"; else return 1; fi
}

# system_packages WHY PACKAGE...: install what is missing; 1 where that is not allowed, after saying what to run.
system_packages() {
  local why=$1 prefix
  shift
  command -v apt-get >/dev/null || { say "$why needs the packages that Debian calls: $*. Install them with this system's package manager."; return 1; }
  prefix=$(install_prefix) || { say "$why: run   sudo apt-get install -y $*"; return 1; }
  say "Installing $* ($why)"
  $prefix DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >/dev/null 2>&1 && return 0
  $prefix apt-get update -qq >/dev/null 2>&1  # package lists may be missing or old
  $prefix DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >/dev/null ||
    { say "$why: the installation failed; run   apt-get install -y $*   and see what it says"; return 1; }
}

# Ordinary users of Debian have no /sbin in their PATH.
has_library() { [[ $(PATH=$PATH:/usr/sbin:/sbin ldconfig -p 2>/dev/null) == *"$1"* ]]; }

find_python() {
  local python
  for python in python3.11 python3.12 python3.13 python3.14 python3; do
    if "$python" -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null; then
      command -v "$python"
      return 0
    fi
  done
  return 1
}

egl_library() {
  has_library libEGL.so.1 && has_library libEGL_mesa.so.0 && return 0
  system_packages "rendering with OpenGL" libegl1 libgl1-mesa-dri libegl-mesa0 ||
    say "Without them a slow NumPy rasteriser is used."
}

# A second way to OpenGL. Mesa 25.1 and later have none, and EGL is enough.
osmesa_library() {
  local prefix
  has_library libOSMesa.so && return 0
  command -v apt-cache >/dev/null || return 0
  if ! apt-cache show libosmesa6 >/dev/null 2>&1; then  # package lists may be missing
    prefix=$(install_prefix) && $prefix apt-get update -qq >/dev/null 2>&1
    apt-cache show libosmesa6 >/dev/null 2>&1 || return 0
  fi
  system_packages "rendering with OSMesa" libosmesa6 || true
}

# Chromium, in which tests open the pages that are written.
browser() {
  command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null ||
    system_packages "opening pages in tests" chromium
}

# In which tests parse the completion.
zsh_shell() { command -v zsh >/dev/null || system_packages "testing completion in zsh" zsh; }

setup() {
  local extras=$1 root stamp want python
  root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
  cd "$root" || exit 1
  egl_library
  want=$(cat pyproject.toml constraints.txt | sha256sum | cut -d' ' -f1)
  stamp=".venv/.installed-$(printf '%s' "${extras:-core}" | tr -c 'a-z' '_')"
  if [ -x .venv/bin/python ] && [ "$(cat "$stamp" 2>/dev/null)" = "$want" ]; then return 0; fi
  osmesa_library
  python=$(find_python) || {
    system_packages "Python 3.11 or newer" python3 python3-venv || exit 1
    python=$(find_python) || die "Python 3.11 to 3.14 is needed; $(python3 --version 2>&1) is what this system has"
  }
  say "Setting up .venv with $("$python" --version) (a few minutes, once)"
  if ! .venv/bin/python -c 'import pip' 2>/dev/null; then
    rm -rf .venv  # absent, or moved from another place, or half-made
    "$python" -m venv .venv || die "could not make .venv; on Debian the package python3-venv is needed"
  fi
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
    --editable ".$extras" 2> >(grep -v 'is ignored: it is neither a file nor a directory' >&2) ||
    die "pip could not install the packages (see above)"
  printf '%s\n' "$want" > "$stamp"
}
