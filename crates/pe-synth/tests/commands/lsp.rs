//! `pe-synth lsp` as an editor starts it.

use std::io::{Read, Write};
use std::process::{Command, Stdio};

/// Exit code and output for these messages.
fn session(messages: &[&str]) -> (Option<i32>, String) {
    let mut server = Command::new(env!("CARGO_BIN_EXE_pe-synth"))
        .args(["lsp", "--stdio"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the server starts");
    let mut input = server.stdin.take().unwrap();
    for message in messages {
        write!(input, "Content-Length: {}\r\n\r\n{message}", message.len()).unwrap();
    }
    drop(input);
    let mut output = String::new();
    server.stdout.take().unwrap().read_to_string(&mut output).unwrap();
    (server.wait().unwrap().code(), output)
}

#[test]
fn exit_codes_are_those_of_the_protocol() {
    let initialize = r#"{"jsonrpc":"2.0","id":1,"method":"initialize","params":{"capabilities":{}}}"#;
    let shutdown = r#"{"jsonrpc":"2.0","id":2,"method":"shutdown"}"#;
    let exit = r#"{"jsonrpc":"2.0","method":"exit"}"#;
    let (code, output) = session(&[initialize, shutdown, exit]);
    assert_eq!(code, Some(0), "{output}");
    assert!(output.contains("\"renameProvider\"") && output.contains("\"id\":2"), "{output}");
    assert_eq!(session(&[initialize, exit]).0, Some(1));
    assert_eq!(session(&[]).0, Some(1));
    assert_eq!(session(&[initialize, "{", shutdown, exit]).0, Some(0));
}
