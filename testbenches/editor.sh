#!/usr/bin/env bash
# Uses the extension of Visual Studio Code in the editor itself: code-server, which is that editor in a browser, driven in
# headless Chromium by editor.py.
#
#   testbenches/editor.sh
#
# Needs what test-all.sh installs, Node.js 20 with npm, and a C++ compiler, for parts of the editor are built. $PE_SYNTH
# names the program that the extension starts. Pictures are in target/editor.
set -euo pipefail
cd "$(dirname "$(realpath "$0")")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
out=$target/editor
for tool in node npm g++ make chromium chromedriver; do
  command -v "$tool" > /dev/null || { echo "editor: $tool is missing" >&2; exit 1; }
done
[[ $(node --version) == v20.* ]] || { echo 'editor: code-server 4.100.3 needs Node.js 20' >&2; exit 1; }
pe_synth=$(realpath "${PE_SYNTH:-$target/debug/pe-synth}")

testbenches/vscode.sh

# Without the scripts of packages: one of them fetches a search tool from elsewhere, which is not needed.
version=4.100.3
if [[ $(cat "$out/server/version" 2> /dev/null) != "$version" ]]; then
  rm -rf "$out/server"
  mkdir -p "$out/server"
  quiet=(--no-audit --no-fund --loglevel=error)
  (
    cd "$out/server"
    npm install "${quiet[@]}" --ignore-scripts --prefix . "code-server@$version"
    npm rebuild argon2 --build-from-source --loglevel=error
    cd node_modules/code-server/lib/vscode
    npm install "${quiet[@]}" --ignore-scripts --omit=dev --legacy-peer-deps
    npm rebuild @vscode/spdlog native-watchdog @parcel/watcher --loglevel=error
    cd extensions
    npm install "${quiet[@]}" --ignore-scripts --omit=dev --legacy-peer-deps
  )
  echo "$version" > "$out/server/version"
fi

own=$out/session
rm -rf "$own" "$out/chromium"
mkdir -p "$own/user/User" "$own/model"
cp models/lotka_volterra/lotka_volterra.spec "$own/model"
cat > "$own/user/User/settings.json" << END
{
  "pe-synth.path": "$pe_synth",
  "editor.hover.delay": 100,
  "extensions.autoCheckUpdates": false,
  "extensions.autoUpdate": false,
  "security.workspace.trust.enabled": false,
  "telemetry.telemetryLevel": "off",
  "workbench.startupEditor": "none"
}
END
export HOME=$own EXTENSIONS_GALLERY='{}'
editor=("$out/server/node_modules/.bin/code-server" --extensions-dir "$own/extensions" --user-data-dir "$own/user")
"${editor[@]}" --install-extension "$target/vscode/pe-synth-0.1.0.vsix"
"${editor[@]}" --auth none --bind-addr 127.0.0.1:0 --disable-telemetry --disable-update-check "$own/model" > "$out/server.log" 2>&1 &
server=$!
trap 'kill "$server" 2> /dev/null || true' EXIT
for _ in {1..120}; do
  address=$(sed -n 's/.*HTTP server listening on \(http[^ ]*\).*/\1/p' "$out/server.log")
  [[ -z $address ]] || break
  sleep 0.5
done
[[ -n $address ]] || { cat "$out/server.log" >&2; exit 1; }
"$target/venv/bin/python" testbenches/editor.py "$address" "$out"
