//! Bytes to messages and back.
//!
//! A stream may hold anything. What is no message is answered with an error and skipped; lines that are no header are
//! skipped, too, so that the next message is found. No size that a header states is taken on trust.

use lsp_server::{ErrorCode, Message};
use serde_json::{Value, json};
use std::io::{self, BufRead, Read, Write};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

/// Bytes of a longer message are skipped: no editor sends a file that the front end would refuse.
pub(crate) const LARGEST: u64 = 256 << 20;

/// Bytes of a line of a header; of a longer one the rest is skipped.
const LONGEST_LINE: u64 = 4096;

/// How long the last answers may take to be written once the session is over.
const PATIENCE: Duration = Duration::from_secs(2);

/// What a stream gives.
pub(crate) enum Incoming {
    /// A message.
    Message(Message),
    /// Something else, and the answer to it.
    Refused(Value),
}

/// The next message, `None` at the end of the stream.
pub(crate) fn read(input: &mut impl BufRead) -> io::Result<Option<Incoming>> {
    let Some(size) = size(input)? else { return Ok(None) };
    if size > LARGEST {
        let skipped = io::copy(&mut input.take(size), &mut io::sink())?;
        let message = format!("a message of {size} bytes; the most allowed is {LARGEST}");
        return Ok((skipped == size).then(|| refused(ErrorCode::InvalidRequest, Value::Null, message)));
    }
    // Memory is taken as the bytes come in.
    let mut body = Vec::new();
    input.take(size).read_to_end(&mut body)?;
    if body.len() as u64 != size {
        return Ok(None);
    }
    Ok(Some(understood(&body)))
}

/// The message in these bytes.
fn understood(body: &[u8]) -> Incoming {
    let value: Value = match serde_json::from_slice(body) {
        Ok(value) => value,
        Err(error) => return refused(ErrorCode::ParseError, Value::Null, format!("no JSON: {error}")),
    };
    let id = value.get("id").filter(|id| id.is_number() || id.is_string()).cloned().unwrap_or_default();
    // A number that no request can have is no reason to leave its sender without an answer.
    let asks = !id.is_null();
    match serde_json::from_value(value) {
        Ok(message) if !(asks && matches!(message, Message::Notification(_))) => Incoming::Message(message),
        _ => refused(ErrorCode::InvalidRequest, id, "no message of the protocol".to_owned()),
    }
}

fn refused(code: ErrorCode, id: Value, message: String) -> Incoming {
    Incoming::Refused(json!({"jsonrpc": "2.0", "id": id, "error": {"code": code as i32, "message": message}}))
}

/// The size that the next header states, `None` at the end of the stream.
fn size(input: &mut impl BufRead) -> io::Result<Option<u64>> {
    let mut size = None;
    let mut line = Vec::new();
    loop {
        line.clear();
        if input.take(LONGEST_LINE).read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if let Some((name, value)) = text.split_once(':')
            && name.trim().eq_ignore_ascii_case("content-length")
        {
            size = value.trim().parse().ok();
        } else if text.is_empty() && size.is_some() {
            return Ok(size);
        }
    }
}

/// Writes messages from a thread of its own, so that an editor that does not read stops nobody.
pub(crate) struct Writer {
    messages: Sender<Value>,
    done: Receiver<()>,
}

impl Writer {
    pub(crate) fn new(mut output: impl Write + Send + 'static) -> Writer {
        let (messages, queue) = channel::<Value>();
        let (finished, done) = channel();
        thread::spawn(move || {
            for message in queue {
                let text = message.to_string();
                let written = write!(output, "Content-Length: {}\r\n\r\n{text}", text.len());
                if written.and_then(|()| output.flush()).is_err() {
                    break;
                }
            }
            let _ = finished.send(());
        });
        Writer { messages, done }
    }

    /// Sends a message. Nobody may be there to read it; the end of the input tells.
    pub(crate) fn send(&self, message: &Message) {
        let mut value = serde_json::to_value(message).unwrap_or_default();
        if let Value::Object(members) = &mut value {
            members.insert("jsonrpc".to_owned(), "2.0".into());
        }
        self.send_value(value);
    }

    pub(crate) fn send_value(&self, value: Value) {
        let _ = self.messages.send(value);
    }

    /// Waits until all is written, but not for long.
    pub(crate) fn finish(self) {
        drop(self.messages);
        let _ = self.done.recv_timeout(PATIENCE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(body: &str) -> String {
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }

    /// Methods of messages, codes of answers to what is none.
    fn all(bytes: &[u8]) -> Vec<String> {
        let mut input = bytes;
        let mut found = Vec::new();
        while let Some(incoming) = read(&mut input).expect("memory can be read") {
            found.push(match incoming {
                Incoming::Message(Message::Request(request)) => request.method,
                Incoming::Message(Message::Notification(notification)) => notification.method,
                Incoming::Message(Message::Response(_)) => "response".to_owned(),
                Incoming::Refused(value) => format!("{} {}", value["id"], value["error"]["code"]),
            });
        }
        found
    }

    #[test]
    fn what_is_no_message_is_answered_and_skipped() {
        let good = framed(r#"{"jsonrpc":"2.0","method":"exit"}"#);
        for (bad, answer) in [
            (framed("{"), Some("null -32700")),
            (framed(""), Some("null -32700")),
            (framed("[]"), Some("null -32600")),
            (framed(r#"{"id":7,"method":8}"#), Some("7 -32600")),
            (framed(r#"{"id":99999999999,"method":"x"}"#), Some("99999999999 -32600")),
            (framed(&"[".repeat(100_000)), Some("null -32700")),
            ("garbage\r\n\r\n\u{0}\u{1}\n".to_owned(), None),
            ("Content-Length: -1\r\n\r\n".to_owned(), None),
            (format!("X: {}\n", "y".repeat(100_000)), None),
        ] {
            let mut wanted: Vec<&str> = answer.into_iter().collect();
            wanted.push("exit");
            assert_eq!(all((bad + &good).as_bytes()), wanted);
        }
        assert_eq!(all(&[b"Content-Length: 2\r\n\r\n\xff\xff", good.as_bytes()].concat()), ["null -32700", "exit"]);
    }

    #[test]
    fn sizes_beyond_the_stream_take_no_memory_and_end_it() {
        for size in [5, LARGEST, LARGEST + 1, u64::MAX] {
            assert!(all(format!("Content-Length: {size}\r\n\r\n{{}}").as_bytes()).is_empty(), "{size}");
        }
        assert!(all(b"Content-Length: 99999999999999999999999\r\n\r\n{}").is_empty());
    }
}
