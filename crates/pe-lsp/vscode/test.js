// The grammar in the engine of Visual Studio Code: every model is read, and each kind of word is found as what it is.
"use strict";

const fs = require("fs");
const path = require("path");
const oniguruma = require("vscode-oniguruma");
const { Registry, INITIAL, parseRawGrammar } = require("vscode-textmate");

const models = process.argv[2];
const file = path.join(__dirname, "syntaxes/ode.tmLanguage.json");

function specs(folder) {
  return fs.readdirSync(folder, { withFileTypes: true }).flatMap((entry) => {
    const at = path.join(folder, entry.name);
    return entry.isDirectory() ? specs(at) : at.endsWith(".spec") ? [at] : [];
  });
}

async function main() {
  const wasm = fs.readFileSync(path.join(path.dirname(require.resolve("vscode-oniguruma/package.json")), "release/onig.wasm"));
  await oniguruma.loadWASM(wasm.buffer.slice(wasm.byteOffset, wasm.byteOffset + wasm.byteLength));
  const registry = new Registry({
    onigLib: Promise.resolve({
      createOnigScanner: (patterns) => new oniguruma.OnigScanner(patterns),
      createOnigString: (text) => new oniguruma.OnigString(text),
    }),
    loadGrammar: async () => parseRawGrammar(fs.readFileSync(file, "utf8"), file),
  });
  const grammar = await registry.loadGrammar("source.ode");
  const seen = new Map();
  const wrong = [];
  const found = specs(models);
  for (const spec of found) {
    for (const line of fs.readFileSync(spec, "utf8").split(/\r?\n/)) {
      for (const token of grammar.tokenizeLine(line, INITIAL).tokens) {
        const text = line.slice(token.startIndex, token.endIndex);
        const scope = token.scopes[token.scopes.length - 1];
        seen.set(scope, (seen.get(scope) || 0) + 1);
        if (scope === "source.ode" && text.trim() !== "") {
          wrong.push(`${path.basename(spec)}: ${text}`);
        }
      }
    }
  }
  const wanted = ["comment.line.double-slash.ode", "string.quoted.double.ode", "keyword.control.statement.ode",
    "constant.numeric.ode", "variable.other.ode", "constant.other.unit.ode", "support.function.ode", "keyword.operator.ode"];
  const missing = wanted.filter((scope) => !seen.get(scope));
  if (found.length < 100 || wrong.length > 0 || missing.length > 0) {
    throw new Error(`${found.length} specs; not told: ${wrong.slice(0, 10).join("; ")}; missing: ${missing.join(", ")}`);
  }
  console.log(`${found.length} specs, ${[...seen.values()].reduce((a, b) => a + b)} tokens, ${seen.size} scopes`);
}

main().catch((error) => {
  console.error(error.message);
  process.exit(1);
});
