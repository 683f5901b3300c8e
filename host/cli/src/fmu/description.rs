//! The description of a unit, `modelDescription.xml`.

use gantry_tau_fmi::instance::{Access, Causality, Instance};
use gantry_tau_fmi::kind::Kind;
use gantry_tau_fmi::variable::{Domain, Enumeration, Unit, Variable};
use gantry_tau_machine::robot_file::CYCLE_US;

use crate::xml::Element;

/// Returns the description of a unit for a machine of this model.
pub(super) fn description(kind: Kind, model: &str, unit: &Instance) -> String {
    let variables = unit.variables();
    let root = Element::new("fmiModelDescription")
        .with("fmiVersion", "2.0")
        .with("modelName", format!("{model} {kind}"))
        .with("guid", unit.guid())
        .with_text("description", kind.description())
        .with("version", env!("CARGO_PKG_VERSION"))
        .with("license", "MIT OR Apache-2.0")
        .with(
            "generationTool",
            format!("gantry-tau {}", env!("CARGO_PKG_VERSION")),
        )
        .with("variableNamingConvention", "structured")
        .with("numberOfEventIndicators", 0)
        .containing([
            co_simulation(kind),
            units(),
            types(variables),
            experiment(),
            model_variables(variables),
            structure(variables),
        ]);
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{root}")
}

fn co_simulation(kind: Kind) -> Element {
    Element::new("CoSimulation")
        .with("modelIdentifier", kind.model_identifier())
        .with("canHandleVariableCommunicationStepSize", true)
        .with("canNotUseMemoryManagementFunctions", true)
        .with("canGetAndSetFMUstate", true)
        .with("canSerializeFMUstate", false)
}

fn experiment() -> Element {
    Element::new("DefaultExperiment")
        .with("startTime", 0)
        .with("stopTime", 2)
        .with_numbers("stepSize", &[f64::from(CYCLE_US) * 1e-6])
}

fn units() -> Element {
    let each = Unit::NAMED.map(|unit| {
        let mut base = Element::new("BaseUnit");
        for (name, exponent) in unit.exponents() {
            if exponent != 0 {
                base = base.with(name, exponent);
            }
        }
        let displayed = unit.displayed().iter().map(|(name, count)| {
            Element::new("DisplayUnit")
                .with("name", name)
                .with_numbers("factor", &[*count])
        });
        Element::new("Unit")
            .with("name", unit.name())
            .containing([base])
            .containing(displayed)
    });
    Element::new("UnitDefinitions").containing(each)
}

/// Types of the variables whose values have names. A unit without one has a type of its switches, as the
/// list must not be empty.
fn types(variables: &[Variable]) -> Element {
    let mut used: Vec<Enumeration> = Vec::new();
    for variable in variables {
        if let Domain::Enumeration(enumeration) = variable.domain {
            if !used.contains(&enumeration) {
                used.push(enumeration);
            }
        }
    }
    let types = used.iter().map(|enumeration| {
        let items = enumeration.items().into_iter();
        let items = items.map(|(code, name, text)| {
            Element::new("Item")
                .with("name", name)
                .with("value", code)
                .with_text("description", &text)
        });
        Element::new("SimpleType")
            .with("name", enumeration.name())
            .containing([Element::new("Enumeration").containing(items)])
    });
    let switch = Element::new("SimpleType")
        .with("name", SWITCH)
        .containing([Element::new("Boolean")]);
    Element::new("TypeDefinitions")
        .containing(types)
        .containing([switch])
}

/// Type of true and false.
const SWITCH: &str = "Switch";

fn model_variables(variables: &[Variable]) -> Element {
    let each = variables.iter().enumerate().map(|(place, variable)| {
        let (variability, initial) = match variable.causality {
            Causality::Parameter => ("fixed", Some("exact")),
            Causality::Input => ("discrete", None),
            Causality::Output => ("discrete", Some("calculated")),
        };
        let mut element = Element::new("ScalarVariable")
            .with_text("name", &variable.name)
            .with("valueReference", place)
            .with_text("description", variable.description)
            .with("causality", variable.causality.name())
            .with("variability", variability);
        if let Some(initial) = initial {
            element = element.with("initial", initial);
        }
        element.containing([typed(variable)])
    });
    Element::new("ModelVariables").containing(each)
}

/// Type of a variable, with its range, and with its start unless that is computed.
fn typed(variable: &Variable) -> Element {
    let [lower, upper] = variable.range;
    let whole = |number: f64| number as i64;
    let element = match variable.domain {
        Domain::Real(unit) => {
            let mut real = Element::new("Real");
            if unit != Unit::One {
                real = real.with("unit", unit.name());
            }
            if let Some((displayed, _)) = unit.displayed().first() {
                real = real.with("displayUnit", displayed);
            }
            // An end beyond every number is none.
            if upper < f64::MAX {
                real = real
                    .with_numbers("min", &[lower])
                    .with_numbers("max", &[upper]);
            }
            real
        }
        Domain::Integer => Element::new("Integer")
            .with("min", whole(lower))
            .with("max", whole(upper)),
        Domain::Boolean => Element::new("Boolean").with("declaredType", SWITCH),
        Domain::Enumeration(enumeration) => {
            Element::new("Enumeration").with("declaredType", enumeration.name())
        }
    };
    if variable.causality == Causality::Output {
        return element;
    }
    match variable.access() {
        Access::Real => element.with_numbers("start", &[variable.start]),
        Access::Integer => element.with("start", whole(variable.start)),
        Access::Boolean => element.with("start", variable.start > 0.5),
    }
}

fn structure(variables: &[Variable]) -> Element {
    let unknowns = || {
        let outputs = variables.iter().enumerate();
        let outputs = outputs.filter(|(_, variable)| variable.causality == Causality::Output);
        outputs.map(|(place, _)| Element::new("Unknown").with("index", place + 1))
    };
    Element::new("ModelStructure").containing([
        Element::new("Outputs").containing(unknowns()),
        Element::new("InitialUnknowns").containing(unknowns()),
    ])
}
