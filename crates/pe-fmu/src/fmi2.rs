//! FMI 2.0 for co-simulation. Names, arguments and order of calls are those of the standard (fmi-standard.org).
#![allow(unsafe_code, non_snake_case, clippy::too_many_arguments, clippy::missing_safety_doc, missing_docs)]

use std::ffi::{CString, c_char, c_int, c_void};

use crate::c::{self, Component, call, each, each_text, lacking, state_functions, text};
use crate::instance::Status;
use crate::saved::Saved;

type Logger = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);

#[repr(C)]
pub struct Callbacks {
    logger: Option<Logger>,
    allocate_memory: *const c_void,
    free_memory: *const c_void,
    step_finished: *const c_void,
    environment: *mut c_void,
}

/// fmi2CoSimulation.
const CO_SIMULATION: c_int = 1;

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut Component {
    // SAFETY: the standard asks the caller for texts and callbacks that outlive the instance.
    unsafe {
        let name = CString::new(text(name)).unwrap_or_default();
        let callbacks = callbacks.as_ref().map(|callbacks| (callbacks.logger, callbacks.environment));
        let log = move |status: Status, message: &str| {
            if let Some((Some(logger), environment)) = callbacks {
                let category = if status == Status::Warning { c"logStatusWarning" } else { c"logStatusError" };
                // A format in C.
                let message = CString::new(message.replace('%', "%%")).unwrap_or_default();
                logger(environment, name.as_ptr(), status as c_int, category.as_ptr(), message.as_ptr());
            }
        };
        if kind != CO_SIMULATION {
            log(Status::Error, "this FMU is for co-simulation only");
            return std::ptr::null_mut();
        }
        Component::open(c::path_of_uri(text(resources)), text(guid), Box::new(log))
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(component: *mut Component) {
    // SAFETY: the caller's handle.
    unsafe { c::free(component) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetDebugLogging(
    component: *mut Component,
    _on: c_int,
    _count: usize,
    _categories: *const *const c_char,
) -> c_int {
    // SAFETY: the caller's handle.
    unsafe { call(component, |_| Ok(())) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    component: *mut Component,
    _tolerance_defined: c_int,
    _tolerance: f64,
    start: f64,
    _stop_defined: c_int,
    _stop: f64,
) -> c_int {
    // SAFETY: the caller's handle.
    unsafe {
        call(component, |component| {
            component.instance.begin_at(start);
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2EnterInitializationMode(component: *mut Component) -> c_int {
    // SAFETY: the caller's handle.
    unsafe { call(component, |component| component.instance.open()) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(component: *mut Component) -> c_int {
    // SAFETY: the caller's handle.
    unsafe { call(component, |_| Ok(())) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Terminate(component: *mut Component) -> c_int {
    // SAFETY: the caller's handle.
    unsafe { call(component, |_| Ok(())) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(component: *mut Component) -> c_int {
    // SAFETY: the caller's handle.
    unsafe {
        call(component, |component| {
            component.instance.reset();
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(c: *mut Component, numbers: *const u32, count: usize, values: *mut f64) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe {
        each(c, numbers, values, count, |component, number, value| {
            *value = component.instance.number(number)?;
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const f64,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_number(number, *value)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetInteger(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut i32,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe {
        each(c, numbers, values, count, |component, number, value| {
            let word = component.instance.integer(number)?;
            *value = i32::try_from(word).map_err(|_| "an integer of 64 bits: take its halves".to_owned())?;
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetInteger(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const i32,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_integer(number, *value)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetString(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut *const c_char,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe { each_text(c, numbers, values, count) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetString(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const *const c_char,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_text(number, text(*value))
        })
    }
}

state_functions! {
    fmi2GetFMUstate fmi2SetFMUstate fmi2FreeFMUstate
    fmi2SerializedFMUstateSize fmi2SerializeFMUstate fmi2DeSerializeFMUstate
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(component: *mut Component, from: f64, by: f64, _no_going_back: c_int) -> c_int {
    // SAFETY: the caller's handle.
    unsafe { call(component, |component| component.instance.advance(from, by)) }
}

lacking! {
    fmi2GetBoolean fmi2SetBoolean fmi2GetDirectionalDerivative fmi2SetRealInputDerivatives fmi2GetRealOutputDerivatives
    fmi2CancelStep fmi2GetStatus fmi2GetRealStatus fmi2GetIntegerStatus fmi2GetBooleanStatus fmi2GetStringStatus
}
