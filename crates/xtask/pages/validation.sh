#!/usr/bin/env bash
# Compiles the validation set and writes docs/validation.md.
#
#   cargo run -p xtask -- validation
#
# Needs cargo only; the references are in models/validation/reference, made by models/validation/reference.py. Takes a
# few minutes. $VALIDATION names a binary of the example `validation` to use in place of building one. Exit code 4: a
# case is not what models/validation/cases.csv asks for; the page says which.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
validation=$(built VALIDATION examples/validation --example validation)
cd "$root"
page=$(mktemp)
trap 'rm -f "$page"' EXIT
code=0
"$validation" > "$page" || code=$?
if ((code == 0 || code == 4)); then
  cp "$page" docs/validation.md
  chmod 644 docs/validation.md
fi
exit "$code"
