//! FMI 3.0 for co-simulation. Names, arguments and order of calls are those of the standard (fmi-standard.org).
#![allow(unsafe_code, non_snake_case, clippy::too_many_arguments, clippy::missing_safety_doc, missing_docs)]

use std::ffi::{CString, c_char, c_int, c_void};
use std::path::PathBuf;

use crate::c::{self, Component, call, each, each_text, lacking, slice_mut, state_functions, text};
use crate::instance::Status;
use crate::saved::Saved;

type Logger = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const u32,
    _intermediate_count: usize,
    environment: *mut c_void,
    logger: Option<Logger>,
    _intermediate_update: *const c_void,
) -> *mut Component {
    // SAFETY: the standard asks the caller for texts, and for an environment that outlives the instance.
    unsafe {
        let log = move |status: Status, message: &str| {
            if let Some(logger) = logger {
                let category = if status == Status::Warning { c"logStatusWarning" } else { c"logStatusError" };
                let message = CString::new(message).unwrap_or_default();
                logger(environment, status as c_int, category.as_ptr(), message.as_ptr());
            }
        };
        let resources = text(resources);
        let path = c::path_of_uri(resources).or_else(|| (!resources.is_empty()).then(|| PathBuf::from(resources)));
        Component::open(path, text(token), Box::new(log))
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange() -> *mut Component {
    std::ptr::null_mut()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution() -> *mut Component {
    std::ptr::null_mut()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(component: *mut Component) {
    // SAFETY: the caller's handle.
    unsafe { c::free(component) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    component: *mut Component,
    _tolerance_defined: bool,
    _tolerance: f64,
    start: f64,
    _stop_defined: bool,
    _stop: f64,
) -> c_int {
    // SAFETY: the caller's handle.
    unsafe {
        call(component, |component| {
            component.instance.begin_at(start);
            component.instance.open()
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(component: *mut Component) -> c_int {
    // SAFETY: the caller's handle.
    unsafe {
        call(component, |component| {
            component.instance.reset();
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut f64,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe {
        each(c, numbers, values, count, |component, number, value| {
            *value = component.instance.number(number)?;
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const f64,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_number(number, *value)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetInt64(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut i64,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe {
        each(c, numbers, values, count, |component, number, value| {
            *value = component.instance.integer(number)?;
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetInt32(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut i32,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe {
        each(c, numbers, values, count, |component, number, value| {
            let word = component.instance.integer(number)?;
            *value = i32::try_from(word).map_err(|_| "an integer of 64 bits".to_owned())?;
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetInt32(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const i32,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_integer(number, *value)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetString(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *mut *const c_char,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values.
    unsafe { each_text(c, numbers, values, count) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetString(
    c: *mut Component,
    numbers: *const u32,
    count: usize,
    values: *const *const c_char,
    _value_count: usize,
) -> c_int {
    // SAFETY: the caller's handle and values, which are read only.
    unsafe {
        each(c, numbers, values.cast_mut(), count, |component, number, value| {
            component.instance.set_text(number, text(*value))
        })
    }
}

state_functions! {
    fmi3GetFMUState fmi3SetFMUState fmi3FreeFMUState
    fmi3SerializedFMUStateSize fmi3SerializeFMUState fmi3DeserializeFMUState
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    component: *mut Component,
    from: f64,
    by: f64,
    _no_going_back: bool,
    event: *mut bool,
    terminate: *mut bool,
    early: *mut bool,
    last: *mut f64,
) -> c_int {
    // SAFETY: the caller's handle and places for answers.
    unsafe {
        call(component, |component| {
            for answer in [event, terminate, early] {
                slice_mut(answer, 1)?[0] = false;
            }
            let advanced = component.instance.advance(from, by);
            slice_mut(last, 1)?[0] = component.instance.time();
            advanced
        })
    }
}

/// Functions that have nothing to do here. Their arguments stay unread.
macro_rules! idle {
    ($($name:ident)*) => {$(
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(component: *mut Component) -> c_int {
            // SAFETY: the caller's handle.
            unsafe { call(component, |_| Ok(())) }
        }
    )*};
}

idle! { fmi3SetDebugLogging fmi3ExitInitializationMode fmi3Terminate }

lacking! {
    fmi3EnterEventMode fmi3GetFloat32 fmi3GetInt8 fmi3GetUInt8 fmi3GetInt16 fmi3GetUInt16 fmi3GetUInt32 fmi3GetUInt64
    fmi3GetBoolean fmi3GetBinary fmi3GetClock fmi3SetFloat32 fmi3SetInt8 fmi3SetUInt8 fmi3SetInt16 fmi3SetUInt16
    fmi3SetUInt32 fmi3SetInt64 fmi3SetUInt64 fmi3SetBoolean fmi3SetBinary fmi3SetClock fmi3GetNumberOfVariableDependencies
    fmi3GetVariableDependencies fmi3GetDirectionalDerivative fmi3GetAdjointDerivative fmi3EnterConfigurationMode
    fmi3ExitConfigurationMode fmi3GetIntervalDecimal fmi3GetIntervalFraction fmi3GetShiftDecimal fmi3GetShiftFraction
    fmi3SetIntervalDecimal fmi3SetIntervalFraction fmi3SetShiftDecimal fmi3SetShiftFraction fmi3EvaluateDiscreteStates
    fmi3UpdateDiscreteStates fmi3EnterContinuousTimeMode fmi3CompletedIntegratorStep fmi3SetTime fmi3SetContinuousStates
    fmi3GetContinuousStateDerivatives fmi3GetEventIndicators fmi3GetContinuousStates fmi3GetNominalsOfContinuousStates
    fmi3GetNumberOfEventIndicators fmi3GetNumberOfContinuousStates fmi3EnterStepMode fmi3GetOutputDerivatives
    fmi3ActivateModelPartition
}
