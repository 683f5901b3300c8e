//! Values of variables.

use gantry_tau_fmi::instance::{Access, CallRefused};

use crate::arguments::{array, fill};
use crate::component::Component;
use crate::registry::call;
use crate::types::{
    FALSE, fmi2Boolean, fmi2Component, fmi2Integer, fmi2Real, fmi2Status, fmi2String,
    fmi2ValueReference,
};

/// A type of the interface, whose values the units have as numbers.
trait Passed: Copy {
    const ACCESS: Access;

    /// Returns the value of a number, which is one of this type.
    fn of(number: f64) -> Self;

    /// Returns the number of a value.
    fn number(self) -> Result<f64, String>;
}

impl Passed for f64 {
    const ACCESS: Access = Access::Real;

    fn of(number: f64) -> Self {
        number
    }

    fn number(self) -> Result<f64, String> {
        Ok(self)
    }
}

/// Of a variable that is an Integer, or an enumeration.
impl Passed for fmi2Integer {
    const ACCESS: Access = Access::Integer;

    #[expect(
        clippy::as_conversions,
        reason = "the units have whole numbers of this type there"
    )]
    fn of(number: f64) -> Self {
        number as Self
    }

    fn number(self) -> Result<f64, String> {
        Ok(f64::from(self))
    }
}

/// A Boolean, which in C is an integer as well.
#[derive(Clone, Copy)]
#[repr(transparent)]
struct Truth(fmi2Boolean);

impl Passed for Truth {
    const ACCESS: Access = Access::Boolean;

    fn of(number: f64) -> Self {
        Self(fmi2Boolean::from(number > 0.5))
    }

    fn number(self) -> Result<f64, String> {
        match self.0 {
            FALSE | 1 => Ok(f64::from(self.0)),
            other => Err(format!("is {other}; expected 0 or 1")),
        }
    }
}

/// # Safety
/// `references` and `values` are null, or point to `count` elements.
unsafe fn get<T: Passed>(
    component: &mut Component,
    references: *const fmi2ValueReference,
    count: usize,
    values: *mut T,
) -> Result<(), CallRefused> {
    // SAFETY: the caller's promise.
    let references = unsafe { array("value references", references, count) }?;
    let instance = &component.instance;
    let read = |reference: &fmi2ValueReference| {
        instance.variable(*reference, T::ACCESS)?;
        instance.get(*reference).map(T::of)
    };
    let found: Vec<T> = references
        .iter()
        .map(read)
        .collect::<Result<_, CallRefused>>()?;
    // SAFETY: the caller's promise.
    Ok(unsafe { fill("values", values, &found) }?)
}

/// # Safety
/// As of [`get`].
unsafe fn set<T: Passed>(
    component: &mut Component,
    references: *const fmi2ValueReference,
    count: usize,
    values: *const T,
) -> Result<(), CallRefused> {
    // SAFETY: the caller's promise.
    let references = unsafe { array("value references", references, count) }?;
    // SAFETY: the caller's promise.
    let values = unsafe { array("values", values, count) }?;
    let instance = &mut component.instance;
    let mut pairs = Vec::with_capacity(count);
    for (reference, value) in references.iter().zip(values) {
        let name = &instance.variable(*reference, T::ACCESS)?.name;
        let number = value.number().map_err(|error| format!("{name}: {error}"))?;
        pairs.push((*reference, number));
    }
    instance.set_all(&pairs)
}

/// Declares a pair of functions of the interface.
macro_rules! access {
    ($get:ident, $set:ident, $value:ty as $passed:ty) => {
        /// Returns values of this type.
        ///
        /// # Safety
        /// The arrays are null, or have `count` elements.
        #[unsafe(no_mangle)]
        pub(crate) unsafe extern "C" fn $get(
            component: fmi2Component,
            references: *const fmi2ValueReference,
            count: usize,
            values: *mut $value,
        ) -> fmi2Status {
            call(component, |component| {
                // SAFETY: the caller's promise.
                unsafe { get::<$passed>(component, references, count, values.cast()) }
            })
        }

        /// Sets values of this type: all, or none of them.
        ///
        /// # Safety
        /// The arrays are null, or have `count` elements.
        #[unsafe(no_mangle)]
        pub(crate) unsafe extern "C" fn $set(
            component: fmi2Component,
            references: *const fmi2ValueReference,
            count: usize,
            values: *const $value,
        ) -> fmi2Status {
            call(component, |component| {
                // SAFETY: the caller's promise.
                unsafe { set::<$passed>(component, references, count, values.cast()) }
            })
        }
    };
}

access!(fmi2GetReal, fmi2SetReal, fmi2Real as fmi2Real);
access!(fmi2GetInteger, fmi2SetInteger, fmi2Integer as fmi2Integer);
access!(fmi2GetBoolean, fmi2SetBoolean, fmi2Boolean as Truth);

/// Refuses a String: no unit has one.
fn strings(component: fmi2Component, count: usize) -> fmi2Status {
    call(component, |_| match count {
        0 => Ok(()),
        _ => Err(CallRefused::because("no variable is a String")),
    })
}

/// No unit has a String.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2GetString(
    component: fmi2Component,
    _references: *const fmi2ValueReference,
    count: usize,
    _values: *mut fmi2String,
) -> fmi2Status {
    strings(component, count)
}

/// No unit has a String.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn fmi2SetString(
    component: fmi2Component,
    _references: *const fmi2ValueReference,
    count: usize,
    _values: *const fmi2String,
) -> fmi2Status {
    strings(component, count)
}
