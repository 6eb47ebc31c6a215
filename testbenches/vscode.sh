#!/usr/bin/env bash
# Tries the grammar of the Visual Studio Code extension in the engine of the editor, on all models, and packages the
# extension.
#
#   testbenches/vscode.sh
#
# Needs Node.js 20 or later and npm, and the network for the packages that package-lock.json pins. The result is
# target/vscode/pe-synth-0.1.0.vsix.
set -euo pipefail
cd "$(dirname "$(realpath "$0")")/.."
for tool in node npm; do
  command -v "$tool" > /dev/null || { echo "vscode: $tool is missing" >&2; exit 1; }
done
models=$PWD/models
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")/vscode
rm -rf "$target"
mkdir -p "$target"
cp -r crates/pe-lsp/vscode/. "$target"
cd "$target"
npm ci --no-audit --no-fund --loglevel=error
node --check extension.js
node test.js "$models"
npm run --silent package
test -s pe-synth-0.1.0.vsix
