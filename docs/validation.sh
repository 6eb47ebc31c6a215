#!/usr/bin/env bash
# Compiles the validation set and writes docs/validation.md.
#
#   docs/validation.sh
#
# Needs cargo only; the references are in models/validation/reference, made by models/validation/reference.py. Takes a
# few minutes. $VALIDATION names a binary of the example `validation` to use in place of building one. Exit code 4: a
# case is not what models/validation/cases.csv asks for; the page says which.
set -euo pipefail

cd "$(dirname "$(dirname "$(realpath "$0")")")"
if [[ -z ${VALIDATION:-} ]]; then
  cargo build --release --quiet -p pe-synth --example validation
  VALIDATION=${CARGO_TARGET_DIR:-target}/release/examples/validation
fi
page=$(mktemp)
trap 'rm -f "$page"' EXIT
code=0
"$VALIDATION" > "$page" || code=$?
if ((code == 0 || code == 4)); then
  cp "$page" docs/validation.md
  chmod 644 docs/validation.md
fi
exit "$code"
