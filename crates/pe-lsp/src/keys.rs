//! What a text is found by: the path of a file, or what else the editor calls it.

use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, percent_decode_str, utf8_percent_encode};
use std::path::{Component, Path, PathBuf};

/// Signs of a path that an address holds as they are.
const PLAIN: &AsciiSet = &NON_ALPHANUMERIC.remove(b'/').remove(b'-').remove(b'_').remove(b'.').remove(b'~');

/// A text, however its address is written.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Key {
    /// A file, by its absolute path without `.` and `..`.
    File(PathBuf),
    /// Something that is no file, such as `untitled:Untitled-1`.
    Other(String),
}

impl Key {
    /// The text at an address.
    pub(crate) fn of(uri: &str) -> Key {
        local_path(uri).map_or_else(|| Key::Other(uri.to_owned()), Key::File)
    }

    /// Its address.
    pub(crate) fn uri(&self) -> String {
        match self {
            Key::Other(uri) => uri.clone(),
            Key::File(path) => {
                let path = path.to_string_lossy().replace('\\', "/");
                let slash = if path.starts_with('/') { "" } else { "/" };
                format!("file://{slash}{}", utf8_percent_encode(&path, PLAIN))
            }
        }
    }

    /// The path, if it is a file.
    pub(crate) fn path(&self) -> Option<&Path> {
        match self {
            Key::File(path) => Some(path),
            Key::Other(_) => None,
        }
    }

    /// The name under which the front end has it as main file.
    pub(crate) fn name(&self) -> String {
        match self {
            Key::File(path) => path.to_string_lossy().into_owned(),
            Key::Other(uri) => uri.clone(),
        }
    }
}

/// The path of a `file` address on this machine.
fn local_path(uri: &str) -> Option<PathBuf> {
    let rest = uri.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("file:")).and(uri.get(5..))?;
    let path = match rest.strip_prefix("//") {
        Some(rest) => {
            let slash = rest.find('/')?;
            let host = &rest[..slash];
            (host.is_empty() || host.eq_ignore_ascii_case("localhost")).then_some(&rest[slash..])?
        }
        None => rest,
    };
    let path = path.split(['?', '#']).next()?;
    let path = percent_decode_str(path).decode_utf8().ok()?;
    // `/c:/model.spec` is a path with a drive.
    let drive = path.as_bytes().get(2) == Some(&b':') && path.as_bytes()[1].is_ascii_alphabetic();
    let path = if drive { &path[1..] } else { &*path };
    if path.contains('\0') || !(path.starts_with('/') || drive) {
        return None;
    }
    let mut normal = PathBuf::new();
    for component in Path::new(path).components() {
        match component {
            Component::ParentDir => _ = normal.pop(),
            Component::CurDir => {}
            other => normal.push(other),
        }
    }
    Some(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_one_file_are_one_key() {
        let key = Key::of("file:///a/b%20c/%C3%A9.spec");
        assert_eq!(key.path(), Some(Path::new("/a/b c/\u{e9}.spec")));
        for uri in ["file:///a/./x/../b c/\u{e9}.spec", "FILE://localhost/a/b%20c/\u{e9}.spec", &key.uri()] {
            assert_eq!(Key::of(uri), key, "{uri}");
        }
        assert_eq!(key.uri(), "file:///a/b%20c/%C3%A9.spec");
    }

    #[test]
    fn what_is_no_file_here_keeps_its_address() {
        for uri in [
            "untitled:Untitled-1",
            "file://elsewhere/a",
            "file:",
            "file://",
            "",
            "file:a",
            "file:///%FF",
            "\u{e9}\u{e9}\u{e9}",
        ] {
            assert_eq!(Key::of(uri), Key::Other(uri.to_owned()));
            assert_eq!(Key::of(uri).uri(), uri);
        }
    }
}
