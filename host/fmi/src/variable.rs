//! Variables of a unit. Their value references are their places in the list; types do not count.

use std::fmt;

use gantry_tau_core::control::message::{Cause, Phase};

/// Role of a variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Causality {
    /// Set before the initialisation, and fixed from its end on.
    Parameter,
    /// Set between two steps.
    Input,
    /// Computed by the steps.
    Output,
}

impl Causality {
    /// Name in the description.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Parameter => "parameter",
            Self::Input => "input",
            Self::Output => "output",
        }
    }
}

/// Unit of a real variable, of the SI.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Length, m.
    Metre,
    /// Velocity, m/s.
    MetrePerSecond,
    /// Force, N.
    Newton,
    /// Moment, N m.
    NewtonMetre,
    /// Angle, rad.
    Radian,
    /// Share, without a unit.
    One,
}

impl Unit {
    /// Every unit with a name.
    pub const NAMED: [Self; 5] = [
        Self::Metre,
        Self::MetrePerSecond,
        Self::Newton,
        Self::NewtonMetre,
        Self::Radian,
    ];

    /// Name; empty for a share.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::MetrePerSecond => "m/s",
            Self::Newton => "N",
            Self::NewtonMetre => "N.m",
            Self::Radian => "rad",
            Self::One => "",
        }
    }

    /// Exponents of kg, m, s and rad.
    #[must_use]
    pub const fn exponents(self) -> [(&'static str, i8); 4] {
        let [kg, m, s, rad] = match self {
            Self::Metre => [0, 1, 0, 0],
            Self::MetrePerSecond => [0, 1, -1, 0],
            Self::Newton => [1, 1, -2, 0],
            Self::NewtonMetre => [1, 2, -2, 0],
            Self::Radian => [0, 0, 0, 1],
            Self::One => [0; 4],
        };
        [("kg", kg), ("m", m), ("s", s), ("rad", rad)]
    }

    /// Units in which a person sees it, with the number of them in one.
    #[must_use]
    pub const fn displayed(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Metre => &[("mm", 1e3), ("um", 1e6)],
            Self::MetrePerSecond => &[("mm/s", 1e3)],
            Self::Radian => &[("mrad", 1e3)],
            _ => &[],
        }
    }
}

/// Values that have names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enumeration {
    /// Phases of the server.
    Phase,
    /// Causes of the end of a session.
    Cause,
}

impl Enumeration {
    /// Name of the type.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Phase => "Phase",
            Self::Cause => "Cause",
        }
    }

    /// Returns the smallest and the largest code.
    pub(crate) fn range(self) -> [f64; 2] {
        let codes = self.items().into_iter().map(|(code, _, _)| f64::from(code));
        codes.fold([0.0; 2], |[least, most], code| {
            [least.min(code), most.max(code)]
        })
    }

    /// Returns code on the wire, name and description of each value.
    #[must_use]
    pub fn items(self) -> Vec<(u8, &'static str, String)> {
        match self {
            Self::Phase => (Phase::ALL.iter())
                .map(|phase| (phase.code(), phase.name(), phase.to_string()))
                .collect(),
            Self::Cause => (Cause::ALL.iter())
                .map(|cause| (cause.code(), cause.name(), cause.to_string()))
                .collect(),
        }
    }
}

/// Type of a variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// Real, in a unit.
    Real(Unit),
    /// Whole number.
    Integer,
    /// True or false.
    Boolean,
    /// One of the values with names.
    Enumeration(Enumeration),
}

/// Type in the calls of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// `fmi2GetReal`, `fmi2SetReal`.
    Real,
    /// `fmi2GetInteger`, `fmi2SetInteger`; for enumerations, too.
    Integer,
    /// `fmi2GetBoolean`, `fmi2SetBoolean`.
    Boolean,
}

impl fmt::Display for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Real => "a Real",
            Self::Integer => "an Integer",
            Self::Boolean => "a Boolean",
        })
    }
}

/// One variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name, with the number of its element: `force[1]`.
    pub name: String,
    /// Description for people.
    pub description: &'static str,
    /// Role.
    pub causality: Causality,
    /// Type.
    pub domain: Domain,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Value before the first step; of true and false 1 and 0.
    pub start: f64,
}

impl Variable {
    /// Type in the calls of the interface.
    #[must_use]
    pub const fn access(&self) -> Access {
        match self.domain {
            Domain::Real(_) => Access::Real,
            Domain::Integer | Domain::Enumeration(_) => Access::Integer,
            Domain::Boolean => Access::Boolean,
        }
    }

    /// Checks a value from outside.
    ///
    /// # Errors
    /// A sentence that names the variable.
    pub(crate) fn check(&self, value: f64) -> Result<(), String> {
        let [lower, upper] = self.range;
        if (lower..=upper).contains(&value) {
            return Ok(());
        }
        let unit = match self.domain {
            Domain::Real(unit) => unit.name(),
            _ => "",
        };
        let text = format!(
            "{}: is {value}; expected from {lower} to {upper} {unit}",
            self.name
        );
        Err(text.trim_end().to_owned())
    }

    /// Text that changes with name, role and type. Ranges and starts are those of a robot file, which
    /// may be edited in a unit.
    pub(crate) fn fingerprint(&self) -> String {
        let domain = match self.domain {
            Domain::Real(unit) => unit.name().to_owned(),
            Domain::Integer => "integer".to_owned(),
            Domain::Boolean => "boolean".to_owned(),
            Domain::Enumeration(enumeration) => {
                let items = enumeration.items().into_iter();
                let items = items.map(|(code, name, _)| format!("{code} {name}"));
                items.collect::<Vec<_>>().join(",")
            }
        };
        format!("{} {} {domain};", self.name, self.causality.name())
    }
}

/// Variables that belong together, of the same type: those of the axes, say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group<const L: usize> {
    first: usize,
}

/// Variables of a unit as they are declared.
#[derive(Clone, Debug, Default)]
pub(crate) struct Declarations {
    pub(crate) variables: Vec<Variable>,
}

impl Declarations {
    /// Declares variables that differ in their number, range and start.
    pub(crate) fn add<const L: usize>(
        &mut self,
        name: &str,
        causality: Causality,
        domain: Domain,
        description: &'static str,
        elements: [([f64; 2], f64); L],
    ) -> Group<L> {
        let first = self.variables.len();
        for (index, (range, start)) in elements.into_iter().enumerate() {
            let name = if L == 1 {
                name.to_owned()
            } else {
                format!("{name}[{}]", index + 1)
            };
            self.variables.push(Variable {
                name,
                description,
                causality,
                domain,
                range,
                start,
            });
        }
        Group { first }
    }

    /// Declares a switch.
    pub(crate) fn switch(
        &mut self,
        name: &str,
        causality: Causality,
        description: &'static str,
        start: bool,
    ) -> Group<1> {
        let element = ([0.0, 1.0], f64::from(u8::from(start)));
        self.add(name, causality, Domain::Boolean, description, [element])
    }
}

/// Values of the variables, in their order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Values(Vec<f64>);

impl Values {
    /// The start values.
    pub(crate) fn starts(variables: &[Variable]) -> Self {
        Self(variables.iter().map(|variable| variable.start).collect())
    }

    /// Returns the values of a group, which is one of the same unit's.
    pub(crate) fn get<const L: usize>(&self, group: Group<L>) -> [f64; L] {
        let from = self.0.get(group.first..).unwrap_or_default();
        from.first_chunk().copied().unwrap_or([0.0; L])
    }

    /// Returns a switch.
    pub(crate) fn is_set(&self, group: Group<1>) -> bool {
        let [value] = self.get(group);
        value > 0.5
    }

    /// Sets the values of a group, which is one of the same unit's.
    pub(crate) fn put<const L: usize>(&mut self, group: Group<L>, values: [f64; L]) {
        let from = self.0.get_mut(group.first..).unwrap_or_default();
        if let Some(chunk) = from.first_chunk_mut() {
            *chunk = values;
        }
    }

    /// Sets a switch.
    pub(crate) fn put_switch(&mut self, group: Group<1>, is_set: bool) {
        self.put(group, [f64::from(u8::from(is_set))]);
    }

    /// Returns a value by its reference.
    pub(crate) fn at(&self, reference: u32) -> Option<f64> {
        self.0.get(usize::try_from(reference).ok()?).copied()
    }

    /// Sets a value by its reference, which exists.
    pub(crate) fn put_at(&mut self, reference: u32, value: f64) {
        let place = usize::try_from(reference).ok();
        if let Some(place) = place.and_then(|index| self.0.get_mut(index)) {
            *place = value;
        }
    }
}
