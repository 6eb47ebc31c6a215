//! What both versions of the interface need to speak C.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use crate::instance::{Instance, Status};
use crate::saved::Saved;

/// Tells a caller something.
pub type Log = Box<dyn Fn(Status, &str)>;

/// What a handle of a caller points to.
pub struct Component {
    /// The instance.
    pub instance: Instance,
    /// Tells the caller something.
    log: Log,
    /// Texts that the caller was handed by the last call.
    texts: Vec<CString>,
}

impl Component {
    /// A handle of an instance of the design under `resources`; null, and a message, if there is none.
    pub fn open(resources: Option<PathBuf>, hash: &str, log: Log) -> *mut Component {
        let resources = resources.ok_or_else(|| "the place of the resources is no path of this computer".to_owned());
        let opened = resources.and_then(|resources| Instance::new(&resources.join(crate::package::DESIGN), hash));
        match opened {
            Ok(instance) => Box::into_raw(Box::new(Component { instance, log, texts: Vec::new() })),
            Err(message) => {
                log(Status::Error, &message);
                std::ptr::null_mut()
            }
        }
    }

    /// Hands texts to the caller, until the next ones.
    fn hand(&mut self, texts: Vec<CString>, values: &mut [*const c_char]) {
        self.texts = texts;
        self.texts.iter().zip(values).for_each(|(text, value)| *value = text.as_ptr());
    }
}

/// Runs a call; nothing unwinds into the caller.
///
/// # Safety
/// `component` is null or a handle that is in use nowhere else.
pub unsafe fn call(component: *mut Component, run: impl FnOnce(&mut Component) -> Result<(), String>) -> i32 {
    // SAFETY: stated above.
    let Some(component) = (unsafe { component.as_mut() }) else { return Status::Error as i32 };
    let mut worst = match catch_unwind(AssertUnwindSafe(|| run(component))) {
        Ok(Ok(())) => Status::Ok,
        Ok(Err(message)) => {
            component.instance.told.push((Status::Error, message));
            Status::Error
        }
        Err(_) => {
            component.instance.told.push((Status::Fatal, "the FMU has a fault: please report it".to_owned()));
            Status::Fatal
        }
    };
    for (status, message) in std::mem::take(&mut component.instance.told) {
        (component.log)(status, &message);
        worst = worst.max(status);
    }
    worst as i32
}

/// Gets or sets values one by one.
///
/// # Safety
/// As [`call`]; there are `count` numbers and `values` of them.
pub unsafe fn each<T>(
    component: *mut Component,
    numbers: *const u32,
    values: *mut T,
    count: usize,
    run: impl Fn(&mut Component, u32, &mut T) -> Result<(), String>,
) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |component| {
            let (numbers, values) = (slice(numbers, count)?, slice_mut(values, count)?);
            numbers.iter().zip(values).try_for_each(|(number, value)| run(component, *number, value))
        })
    }
}

/// Gets texts.
///
/// # Safety
/// As [`each`].
pub unsafe fn each_text(
    component: *mut Component,
    numbers: *const u32,
    values: *mut *const c_char,
    count: usize,
) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |component| {
            let (numbers, values) = (slice(numbers, count)?, slice_mut(values, count)?);
            let text = |number: &u32| Ok(CString::new(component.instance.text(*number)?).unwrap_or_default());
            let texts = numbers.iter().map(text).collect::<Result<_, String>>()?;
            component.hand(texts, values);
            Ok(())
        })
    }
}

/// Numbers of a caller.
///
/// # Safety
/// There are as many.
pub unsafe fn slice<'a, T>(first: *const T, count: usize) -> Result<&'a [T], String> {
    match (count, first.is_null()) {
        (0, _) => Ok(&[]),
        (_, true) => Err("null in place of values".to_owned()),
        // SAFETY: stated above.
        _ => Ok(unsafe { std::slice::from_raw_parts(first, count) }),
    }
}

/// The same to write to.
///
/// # Safety
/// There are as many, in use nowhere else.
pub unsafe fn slice_mut<'a, T>(first: *mut T, count: usize) -> Result<&'a mut [T], String> {
    match (count, first.is_null()) {
        (0, _) => Ok(&mut []),
        (_, true) => Err("null in place of values".to_owned()),
        // SAFETY: stated above.
        _ => Ok(unsafe { std::slice::from_raw_parts_mut(first, count) }),
    }
}

/// A text of a caller; empty for null.
///
/// # Safety
/// It ends with a zero.
pub unsafe fn text<'a>(text: *const c_char) -> &'a str {
    if text.is_null() {
        return "";
    }
    // SAFETY: stated above.
    unsafe { CStr::from_ptr(text) }.to_str().unwrap_or("")
}

/// Takes the state of an instance.
///
/// # Safety
/// As [`call`]; `state` points to null or to a state that was taken.
pub unsafe fn take_state(component: *mut Component, state: *mut *mut Saved) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |component| {
            let state = slice_mut(state, 1)?;
            let saved = component.instance.save()?;
            match state[0].as_mut() {
                Some(place) => *place = saved,
                None => state[0] = Box::into_raw(Box::new(saved)),
            }
            Ok(())
        })
    }
}

/// Goes on from a state.
///
/// # Safety
/// As [`call`]; `state` is a state that was taken.
pub unsafe fn set_state(component: *mut Component, state: *mut Saved) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |component| {
            let state = state.as_ref().ok_or_else(|| "null in place of a state".to_owned())?;
            component.instance.restore(state)
        })
    }
}

/// Drops a state; its place is null from then on.
///
/// # Safety
/// As [`take_state`].
pub unsafe fn free_state(component: *mut Component, state: *mut *mut Saved) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |_| {
            if let Some(place) = state.as_mut()
                && !place.is_null()
            {
                drop(Box::from_raw(*place));
                *place = std::ptr::null_mut();
            }
            Ok(())
        })
    }
}

/// Number of bytes of a state.
///
/// # Safety
/// As [`set_state`].
pub unsafe fn state_bytes(component: *mut Component, state: *mut Saved, size: *mut usize) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |_| {
            let state = state.as_ref().ok_or_else(|| "null in place of a state".to_owned())?;
            slice_mut(size, 1)?[0] = state.bytes().len();
            Ok(())
        })
    }
}

/// Writes a state as bytes.
///
/// # Safety
/// As [`set_state`]; there are `size` bytes.
pub unsafe fn write_state(component: *mut Component, state: *mut Saved, bytes: *mut u8, size: usize) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |_| {
            let state = state.as_ref().ok_or_else(|| "null in place of a state".to_owned())?;
            let written = state.bytes();
            let place = slice_mut(bytes, size)?;
            let place = place.get_mut(..written.len()).ok_or_else(|| format!("a state has {} bytes", written.len()))?;
            place.copy_from_slice(&written);
            Ok(())
        })
    }
}

/// Reads a state from bytes.
///
/// # Safety
/// As [`take_state`]; there are `size` bytes.
pub unsafe fn read_state(component: *mut Component, bytes: *const u8, size: usize, state: *mut *mut Saved) -> i32 {
    // SAFETY: stated above.
    unsafe {
        call(component, |_| {
            let saved = Saved::of(slice(bytes, size)?).ok_or_else(|| "these bytes are no state".to_owned())?;
            let state = slice_mut(state, 1)?;
            match state[0].as_mut() {
                Some(place) => *place = saved,
                None => state[0] = Box::into_raw(Box::new(saved)),
            }
            Ok(())
        })
    }
}

/// The functions of a version that take, set, free and convert states, under its names.
macro_rules! state_functions {
    ($take:ident $set:ident $free:ident $size:ident $write:ident $read:ident) => {
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $take(component: *mut Component, state: *mut *mut Saved) -> c_int {
            // SAFETY: the caller's handle and state.
            unsafe { c::take_state(component, state) }
        }

        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $set(component: *mut Component, state: *mut Saved) -> c_int {
            // SAFETY: the caller's handle and state.
            unsafe { c::set_state(component, state) }
        }

        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $free(component: *mut Component, state: *mut *mut Saved) -> c_int {
            // SAFETY: the caller's handle and state.
            unsafe { c::free_state(component, state) }
        }

        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $size(component: *mut Component, state: *mut Saved, size: *mut usize) -> c_int {
            // SAFETY: the caller's handle and state.
            unsafe { c::state_bytes(component, state, size) }
        }

        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $write(
            component: *mut Component,
            state: *mut Saved,
            bytes: *mut u8,
            size: usize,
        ) -> c_int {
            // SAFETY: the caller's handle, state and bytes.
            unsafe { c::write_state(component, state, bytes, size) }
        }

        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $read(
            component: *mut Component,
            bytes: *const u8,
            size: usize,
            state: *mut *mut Saved,
        ) -> c_int {
            // SAFETY: the caller's handle, bytes and state.
            unsafe { c::read_state(component, bytes, size, state) }
        }
    };
}
pub(crate) use state_functions;

/// Functions of the interface that this FMU declares not to have. Their arguments stay unread.
macro_rules! lacking {
    ($($name:ident)*) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(component: *mut Component) -> c_int {
            // SAFETY: the caller's handle.
            unsafe { call(component, |_| Err(format!("{} is not supported", stringify!($name)))) }
        }
    )*};
}
pub(crate) use lacking;

/// Frees a handle.
///
/// # Safety
/// `component` is null or a handle that nobody uses any more.
pub unsafe fn free(component: *mut Component) {
    if !component.is_null() {
        // SAFETY: stated above.
        let component = unsafe { Box::from_raw(component) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(component)));
    }
}

/// The path that a URI of a file names; none for other URIs.
pub fn path_of_uri(uri: &str) -> Option<PathBuf> {
    let rest = uri.strip_prefix("file:")?;
    let path = match rest.strip_prefix("//") {
        Some(behind) => &behind[behind.find('/')?..],
        None => rest,
    };
    let mut bytes = Vec::new();
    let mut left = path.bytes();
    while let Some(byte) = left.next() {
        let digit = |byte: Option<u8>| byte.and_then(|byte| char::from(byte).to_digit(16));
        bytes.push(match byte {
            b'%' => u8::try_from(16 * digit(left.next())? + digit(left.next())?).ok()?,
            _ => byte,
        });
    }
    let path = String::from_utf8(bytes).ok()?;
    // `/C:/` of Windows.
    let drive = path.as_bytes().get(2) == Some(&b':');
    Some(Path::new(if drive { &path[1..] } else { &path }).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_of_files_are_paths() {
        let path = |uri| path_of_uri(uri).map(|path| path.to_str().unwrap().to_owned());
        assert_eq!(path("file:///tmp/a%20b/%C3%A9").as_deref(), Some("/tmp/a b/\u{e9}"));
        assert_eq!(path("file:/tmp/a").as_deref(), Some("/tmp/a"));
        assert_eq!(path("file://localhost/tmp/a").as_deref(), Some("/tmp/a"));
        assert_eq!(path("file:///C:/tmp").as_deref(), Some("C:/tmp"));
        for uri in ["", "http://a/b", "file://host", "file:///a%2", "file:///a%zz"] {
            assert_eq!(path(uri), None, "{uri}");
        }
    }
}
