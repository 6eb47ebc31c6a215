// Starts `pe-synth lsp` for specs and connects the editor with it.
"use strict";

const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

async function start() {
  const command = vscode.workspace.getConfiguration("pe-synth").get("path") || "pe-synth";
  const server = { command, args: ["lsp"] };
  const specs = [
    { scheme: "file", language: "ode" },
    { scheme: "untitled", language: "ode" },
  ];
  client = new LanguageClient("pe-synth", "pe-synth", server, { documentSelector: specs });
  try {
    await client.start();
  } catch (error) {
    const chosen = await vscode.window.showErrorMessage(
      `The language server does not start: ${error.message}. The setting pe-synth.path says where the program is.`,
      "Open the setting",
    );
    if (chosen) {
      await vscode.commands.executeCommand("workbench.action.openSettings", "pe-synth.path");
    }
  }
}

async function stop() {
  const running = client;
  client = undefined;
  if (running && running.needsStop()) {
    await running.stop();
  }
}

async function restart() {
  await stop();
  await start();
}

function activate(context) {
  context.subscriptions.push(
    vscode.commands.registerCommand("pe-synth.restart", restart),
    vscode.workspace.onDidChangeConfiguration((change) => {
      if (change.affectsConfiguration("pe-synth.path")) {
        restart();
      }
    }),
  );
  return start();
}

module.exports = { activate, deactivate: stop };
