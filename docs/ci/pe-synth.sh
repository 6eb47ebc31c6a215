#!/usr/bin/env bash
# Recompiles designs, compares them with what is kept of them, and runs them in GHDL.
#
#   pe-synth.sh [--update] GOLDEN_FOLDER...
#
# Each folder was written by `pe-synth golden`; its report.json holds the command that compiles the design, which is run
# from the current folder. With --update the new figures are kept in place of the comparison. Exit code 1 if a design
# cannot be compiled, differs, or fails in GHDL; the others are checked all the same.
#
#   PE_SYNTH    the program, default pe-synth
#   TOLERANCE   passed on to `pe-synth diff --tolerance`, default its own
#   OUT         where designs are written, default out/ci
#
# Needs bash, jq and ghdl.
set -euo pipefail

update=false
if [[ ${1:-} == --update ]]; then
  update=true
  shift
fi
if (($# == 0)); then
  sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
pe_synth=${PE_SYNTH:-pe-synth}
out=${OUT:-out/ci}
tolerance=()
if [[ -n ${TOLERANCE:-} ]]; then tolerance=(--tolerance "$TOLERANCE"); fi

check() {
  local golden=$1 design=$2 command words
  command=$(jq --exit-status --raw-output .command "$golden/report.json")
  # xargs takes the words apart as a shell would, but runs none of them.
  mapfile -t words < <(xargs -n 1 printf '%s\n' <<< "$command")
  [[ ${words[0]} == pe-synth && ${words[1]} == compile ]] || return 1
  "$pe_synth" "${words[@]:1}" -o "$design" || return 1
  if $update; then
    "$pe_synth" golden "$design" -o "$golden"
  else
    "$pe_synth" diff "$golden" "$design" "${tolerance[@]}" && "$pe_synth" verify "$design"
  fi
}

failed=()
for golden in "$@"; do
  golden=${golden%/}
  design=$out/${golden//\//-}
  echo "== $golden"
  check "$golden" "$design" || failed+=("$golden")
done
if ((${#failed[@]} > 0)); then
  echo "pe-synth.sh: ${#failed[@]} of $# failed: ${failed[*]}" >&2
  exit 1
fi
echo "pe-synth.sh: $# designs as expected"
