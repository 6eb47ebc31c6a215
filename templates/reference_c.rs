/// The interface for other languages, `{{ model }}.h` of `compile --header`. No function prints, ends the process or lets
/// a panic out.
#[allow(non_snake_case)]
mod c {
    use super::{Error, Form, Network};
    use std::ffi::c_char;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    const OK: i32 = 0;
    const NOT_DEFINED: i32 = 1;
    const NO_NETWORK: i32 = -1;
    const LENGTH: i32 = -2;
    const RANGE: i32 = -3;
    const INTERNAL: i32 = -4;

    fn code(result: Result<(), Error>) -> i32 {
        match result {
            Ok(()) => OK,
            Err(Error::Length) => LENGTH,
            Err(Error::Range(_)) => RANGE,
            Err(Error::NoFastForm) => INTERNAL,
        }
    }

    /// A panic would be a mistake of this file, and must not reach a caller who knows no panics.
    fn guarded(work: impl FnOnce() -> i32) -> i32 {
        catch_unwind(AssertUnwindSafe(work)).unwrap_or(INTERNAL)
    }

    /// # Safety
    /// `network` is null or comes from `{{ model }}_new`, and nothing else uses it.
    unsafe fn with(network: *mut Network, work: impl FnOnce(&mut Network) -> i32) -> i32 {
        match unsafe { network.as_mut() } {
            Some(network) => guarded(|| work(network)),
            None => NO_NETWORK,
        }
    }

    /// Words of a caller; none if there are some but no place.
    ///
    /// # Safety
    /// `words` is null or the first of `count`.
    unsafe fn slice<'a>(words: *const i64, count: usize) -> Option<&'a [i64]> {
        match (count, words.is_null()) {
            (0, _) => Some(&[]),
            (_, true) => None,
            (_, false) if count > isize::MAX as usize / 8 => None,
            (_, false) => Some(unsafe { std::slice::from_raw_parts(words, count) }),
        }
    }

    /// The same, to be written.
    ///
    /// # Safety
    /// As above, and nothing else uses them.
    unsafe fn slice_mut<'a>(words: *mut i64, count: usize) -> Option<&'a mut [i64]> {
        match (count, words.is_null()) {
            (0, _) => Some(&mut []),
            (_, true) => None,
            (_, false) if count > isize::MAX as usize / 8 => None,
            (_, false) => Some(unsafe { std::slice::from_raw_parts_mut(words, count) }),
        }
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_interface() -> i32 {
        1
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_hash() -> *const c_char {
        "{{ hash }}\0".as_ptr().cast()
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_inputs() -> usize {
        Network::INPUTS
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_outputs() -> usize {
        Network::OUTPUTS
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_state_words() -> usize {
        Network::STATE_WORDS
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_clocks() -> u32 {
        Network::CLOCKS
    }

    #[no_mangle]
    pub extern "C" fn {{ model }}_new(form: i32) -> *mut Network {
        let form = match form {
            0 => Form::Fast,
            1 => Form::Clocked,
            _ => return std::ptr::null_mut(),
        };
        let network = catch_unwind(|| Network::new(form).ok()).ok().flatten();
        network.map_or(std::ptr::null_mut(), |network| Box::into_raw(Box::new(network)))
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_free(network: *mut Network) {
        if !network.is_null() {
            guarded(|| {
                drop(unsafe { Box::from_raw(network) });
                OK
            });
        }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_reset(network: *mut Network) -> i32 {
        let reset = |network: &mut Network| {
            network.reset();
            OK
        };
        unsafe { with(network, reset) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_step(network: *mut Network, steps: u64) -> i32 {
        let step = |network: &mut Network| {
            network.step(steps);
            OK
        };
        unsafe { with(network, step) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_set_inputs(network: *mut Network, words: *const i64, count: usize) -> i32 {
        let Some(words) = (unsafe { slice(words, count) }) else { return LENGTH };
        unsafe { with(network, |network| code(network.set_inputs(words))) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_get_outputs(network: *mut Network, words: *mut i64, count: usize) -> i32 {
        let Some(words) = (unsafe { slice_mut(words, count) }) else { return LENGTH };
        let read = |network: &mut Network| {
            if words.len() != Network::OUTPUTS {
                return LENGTH;
            }
            let mut all = OK;
            for (index, word) in words.iter_mut().enumerate() {
                *word = network.output(index).unwrap_or_else(|| {
                    all = NOT_DEFINED;
                    0
                });
            }
            all
        };
        unsafe { with(network, read) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_get_state(network: *mut Network, words: *mut i64, count: usize) -> i32 {
        let Some(words) = (unsafe { slice_mut(words, count) }) else { return LENGTH };
        unsafe { with(network, |network| code(network.state(words))) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_set_state(network: *mut Network, words: *const i64, count: usize) -> i32 {
        let Some(words) = (unsafe { slice(words, count) }) else { return LENGTH };
        unsafe { with(network, |network| code(network.set_state(words))) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_flags(network: *mut Network, flags: *mut u32) -> i32 {
        let Some(flags) = (unsafe { flags.as_mut() }) else { return LENGTH };
        let read = |network: &mut Network| {
            *flags = network.flags();
            OK
        };
        unsafe { with(network, read) }
    }

    #[no_mangle]
    pub unsafe extern "C" fn {{ model }}_clear_flags(network: *mut Network) -> i32 {
        let clear = |network: &mut Network| {
            network.clear_flags();
            OK
        };
        unsafe { with(network, clear) }
    }
}
