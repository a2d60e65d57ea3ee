//! What an effect file declares about its parameters and states.

use super::{
    compile::{STATES_MAX, Symbol, is_name, is_reserved, narrow},
    document::{At, FAULTS_MAX, Faults, Table, Text},
    parser::UNKNOWN_VARIABLE,
    problem::Fault,
    program::Operation,
    unit::Unit,
};
use crate::load_model::effect::{Parameter, Prior, Reference, Role, Scale};

/// Most parameters.
pub(super) const PARAMETERS_MAX: usize = 12;
/// Most points of the grid of all shapes together.
pub(super) const GRID_POINTS_MAX: usize = 64;

/// A parameter with the texts of its own.
#[derive(Clone, Debug)]
pub(super) struct OwnedParameter {
    pub(super) name: String,
    pub(super) symbol: String,
    pub(super) unit: String,
    /// All but the texts.
    pub(super) numbers: Parameter,
    /// Values of a shape at which a screen looks.
    pub(super) grid: Vec<f64>,
    /// Where it is in the file, and its lower bound.
    pub(super) at: usize,
    pub(super) lower_at: usize,
    pub(super) measure: Unit,
    /// Whether nothing is wrong with it.
    pub(super) sound: bool,
}

/// A state with its expressions.
#[derive(Clone, Debug)]
pub(super) struct OwnedState {
    pub(super) name: Text,
    pub(super) unit: String,
    pub(super) measure: Unit,
    pub(super) initial: Option<Text>,
    pub(super) derivative: Option<Text>,
}

pub(super) const AMPLITUDE_NEEDED: &str = "one parameter needs role = \"one_sided\" or \"two_sided\": at its \
                                           neutral value the effect is absent";
const UNITS: &str = "units are 1 or pu, s, 1/s, s^2, pu/s and the like; time is in s, shares are \
                     not in %, frequency is per unit";

fn measure(unit: &Text, faults: &mut Faults) -> Unit {
    Unit::parse(&unit.value).unwrap_or_else(|| {
        faults.add(unit.at, format!("unknown unit `{:.20}`", unit.value), UNITS);
        Unit::UNKNOWN
    })
}

/// A name for a parameter or state: what JSON and configuration call it.
pub(super) fn identifier(text: &Text, what: &str, faults: &mut Faults) {
    let plain = text
        .value
        .chars()
        .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
    if !plain || !is_name(&text.value) {
        let message = format!("`{:.60}` is no {what}", text.value);
        let cure = "small letters, digits and _, beginning with a letter, 40 at most";
        faults.add(text.at, message, cure);
    }
}

fn symbol(text: &Text, faults: &mut Faults) {
    if !is_name(&text.value) {
        let message = format!("`{:.60}` is no symbol", text.value);
        let cure = "letters, digits and _, beginning with a letter, 40 at most";
        faults.add(text.at, message, cure);
    } else if is_reserved(&text.value) {
        let message = format!("`{}` is a variable or function already", text.value);
        faults.add(text.at, message, "choose another symbol");
    }
}

/// Names that expressions may use and that declarations at fault leave open: what is wrong with an expression because of
/// them was told there.
#[derive(Debug, Default)]
pub(super) struct Open {
    /// Whether any declaration has no name of its own for expressions.
    pub(super) unnamed: bool,
    /// Names that are variables or functions already.
    pub(super) taken: Vec<String>,
}

impl Open {
    /// Of what was declared, and of how many declarations there are.
    pub(super) fn new(
        (parameters, states): (&[OwnedParameter], &[OwnedState]),
        count: usize,
    ) -> Self {
        let symbols = parameters.iter().map(|p| p.symbol.as_str());
        let names = symbols.chain(states.iter().map(|s| s.name.value.as_str()));
        let none = parameters.is_empty() || parameters.len() + states.len() < count;
        Self {
            unnamed: none || names.clone().any(|name| !is_name(name)),
            taken: names
                .filter(|n| is_reserved(n))
                .map(str::to_owned)
                .collect(),
        }
    }

    /// Whether a fault of an expression may come from what is open.
    pub(super) fn explains(&self, expression: &str, fault: &Fault) -> bool {
        let word = |name: &String| {
            let mut words = expression.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            words.any(|word| word == name)
        };
        self.unnamed && fault.message.starts_with(UNKNOWN_VARIABLE) || self.taken.iter().any(word)
    }
}

/// The parameters, those that can be read.
pub(super) fn parameters(
    tables: Vec<Table<'_>>,
    at: usize,
    faults: &mut Faults,
) -> Vec<OwnedParameter> {
    if tables.len() > PARAMETERS_MAX {
        let message = format!("{} parameters", tables.len());
        faults.add(
            tables[PARAMETERS_MAX].at,
            message,
            format!("at most {PARAMETERS_MAX}"),
        );
    }
    let count = tables.len();
    let first = tables.first().map_or(at, |table| table.at);
    let tables = tables.into_iter().take(PARAMETERS_MAX);
    let found: Vec<OwnedParameter> = tables.filter_map(|t| parameter(t, faults)).collect();
    // One that cannot be read may be meant as an amplitude.
    let all_read = found.len() == count && found.iter().all(|p| p.sound);
    if all_read && count > 0 && !found.iter().any(|p| p.numbers.is_amplitude()) {
        faults.add(first, "no amplitude", AMPLITUDE_NEEDED);
    }
    for (k, p) in found.iter().enumerate() {
        if found[..k]
            .iter()
            .any(|q| !p.name.is_empty() && q.name == p.name)
        {
            faults.add(
                p.at,
                format!("parameter `{}` appears twice", p.name),
                "rename one",
            );
        }
    }
    let points: usize = found.iter().map(|p| p.grid.len().max(1)).product();
    if points > GRID_POINTS_MAX {
        let message = format!("the grids of the shapes have {points} points together");
        faults.add(first, message, format!("at most {GRID_POINTS_MAX}"));
    }
    found
}

fn parameter(mut table: Table<'_>, faults: &mut Faults) -> Option<OwnedParameter> {
    let before = faults.0.len();
    let at = table.at;
    let lower_at = table.place("lower").unwrap_or(at);
    let name = table.needed_text("name", "the name in JSON, with the unit last", faults);
    let short = table.needed_text("symbol", "what the expressions call it", faults);
    let unit = table.needed_text("unit", UNITS, faults);
    let role = role(&mut table, faults);
    let numbers = numbers(&mut table, role, faults);
    let grid = grid(&mut table, role, numbers.as_ref(), faults);
    table.finish(faults);
    if let Some(name) = &name {
        identifier(name, "parameter name", faults);
    }
    if let Some(short) = &short {
        symbol(short, faults);
    }
    let measure = unit.as_ref().map(|unit| measure(unit, faults));
    // What is known still lets the expressions be read.
    let text = |text: Option<Text>| text.map_or_else(String::new, |text| text.value);
    Some(OwnedParameter {
        symbol: short?.value,
        name: text(name),
        unit: text(unit),
        numbers: numbers.unwrap_or_else(|| placeholder(role.unwrap_or(Role::Shape))),
        grid,
        at,
        lower_at,
        measure: measure.unwrap_or(Unit::UNKNOWN),
        sound: faults.0.len() == before && before < FAULTS_MAX,
    })
}

fn placeholder(role: Role) -> Parameter {
    Parameter {
        role,
        ..Parameter::shape(["", "", ""], [0.0, 0.5, 1.0], 1.0)
    }
}

fn role(table: &mut Table<'_>, faults: &mut Faults) -> Option<Role> {
    const ROLES: &str = "one_sided (amplitude from its lower bound), two_sided (amplitude of \
                         either sign) or shape";
    let role = table.needed_text("role", ROLES, faults)?;
    let meaningful = match role.value.as_str() {
        "one_sided" | "two_sided" => {
            let meaning = "the smallest size of the amplitude worth reporting";
            table.needed_number("meaningful", meaning, faults)
        }
        other => {
            let given = table
                .number("meaningful", faults)
                .filter(|_| other == "shape");
            if let Some(given) = given {
                faults.add(given.at, "a shape has no `meaningful`", "remove it");
            }
            None
        }
    };
    match role.value.as_str() {
        "shape" => Some(Role::Shape),
        "one_sided" => Some(Role::OneSidedAmplitude {
            meaningful: meaningful?.value,
        }),
        "two_sided" => Some(Role::TwoSidedAmplitude {
            meaningful: meaningful?.value,
        }),
        other => {
            faults.add(role.at, format!("unknown role `{other:.40}`"), ROLES);
            None
        }
    }
}

fn numbers(table: &mut Table<'_>, role: Option<Role>, faults: &mut Faults) -> Option<Parameter> {
    let lower = table.needed_number("lower", "the smallest value it may take", faults);
    let upper = table.needed_number("upper", "the largest value it may take", faults);
    let typical = table.needed_number("typical", "a common value, to start from", faults);
    let neutral = table.number("neutral", faults);
    let prior = table.section("prior", faults);
    let (lower, upper, typical, role) = (lower?, upper?, typical?, role?);
    let default = match role {
        Role::OneSidedAmplitude { .. } => lower.value,
        Role::TwoSidedAmplitude { .. } => 0.0,
        _ => typical.value,
    };
    let neutral = neutral.unwrap_or(At {
        value: default,
        at: table.at,
    });
    let prior = prior.map(|t| self::prior(t, &typical, faults));
    let unknown = Prior {
        centre: neutral.value,
        deviation: f64::INFINITY,
        scale: Scale::Linear,
    };
    check_range([&lower, &typical, &upper], &neutral, role, faults);
    let prior = prior.unwrap_or(Some(unknown))?;
    let half_known = matches!(role, Role::Shape) && !prior.deviation.is_finite();
    if half_known {
        let cure = "give prior = { deviation = ..., scale = \"linear\" or \"logarithmic\" }";
        faults.add(table.at, "a shape needs a prior", cure);
    }
    if prior.scale == Scale::Logarithmic && lower.value <= 0.0 {
        faults.add(
            lower.at,
            "a logarithmic prior on a range that reaches 0",
            "raise `lower`",
        );
    }
    Some(Parameter {
        name: "",
        symbol: "",
        unit: "",
        lower: lower.value,
        upper: upper.value,
        neutral: neutral.value,
        typical: typical.value,
        prior,
        role,
        reference: Reference::Anywhere,
        resolution: 0.0,
    })
}

fn check_range(
    [lower, typical, upper]: [&At<f64>; 3],
    neutral: &At<f64>,
    role: Role,
    faults: &mut Faults,
) {
    if lower.value >= upper.value {
        let message = format!(
            "`lower` {} is not below `upper` {}",
            lower.value, upper.value
        );
        faults.add(lower.at, message, "");
        return;
    }
    let range = lower.value..=upper.value;
    for (key, given) in [("typical", typical), ("neutral", neutral)] {
        if !range.contains(&given.value) {
            let message = format!("`{key}` {} is outside the bounds", given.value);
            let cure = format!("between {} and {}", lower.value, upper.value);
            faults.add(given.at, message, cure);
        }
    }
    let apart = (neutral.value - lower.value).abs();
    let (Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful }) = role
    else {
        if (neutral.value - typical.value).abs() > 0.0 {
            faults.add(
                neutral.at,
                "the neutral value of a shape is its typical one",
                "remove it",
            );
        }
        return;
    };
    let one_sided = matches!(role, Role::OneSidedAmplitude { .. });
    if one_sided && apart > 0.0 {
        let cure = "its neutral value is the lower bound; otherwise it is two_sided";
        faults.add(neutral.at, "a one-sided amplitude between its bounds", cure);
    }
    if !one_sided && (apart <= 0.0 || neutral.value >= upper.value) {
        let cure = "its neutral value lies between the bounds; otherwise it is one_sided";
        faults.add(neutral.at, "a two-sided amplitude on a bound", cure);
    }
    if !(meaningful > 0.0 && meaningful < upper.value - neutral.value) {
        let cure = format!("above 0 and below {}", upper.value - neutral.value);
        faults.add(neutral.at, format!("`meaningful` is {meaningful}"), cure);
    }
}

fn prior(mut table: Table<'_>, typical: &At<f64>, faults: &mut Faults) -> Option<Prior> {
    let centre = table.number("centre", faults).unwrap_or(At {
        value: typical.value,
        at: typical.at,
    });
    let deviation = table.needed_number("deviation", "the standard deviation", faults);
    let scale = match table.text("scale", faults) {
        None => Some(Scale::Linear),
        Some(text) => match text.value.as_str() {
            "linear" => Some(Scale::Linear),
            "logarithmic" => Some(Scale::Logarithmic),
            other => {
                let cure = "linear, or logarithmic: the deviation is that of the logarithm";
                faults.add(text.at, format!("unknown scale `{other:.40}`"), cure);
                None
            }
        },
    };
    table.finish(faults);
    let deviation = deviation?;
    if deviation.value <= 0.0 {
        faults.add(
            deviation.at,
            format!("`deviation` is {}", deviation.value),
            "above 0",
        );
    }
    if scale == Some(Scale::Logarithmic) && centre.value <= 0.0 {
        faults.add(
            centre.at,
            "the centre of a logarithmic prior is not positive",
            "above 0",
        );
    }
    Some(Prior {
        centre: centre.value,
        deviation: deviation.value,
        scale: scale?,
    })
}

fn grid(
    table: &mut Table<'_>,
    role: Option<Role>,
    numbers: Option<&Parameter>,
    faults: &mut Faults,
) -> Vec<f64> {
    let Some(given) = table.numbers("grid", faults) else {
        return Vec::new();
    };
    if role.is_some_and(|role| role != Role::Shape) {
        faults.add(given.at, "only a shape has a grid", "remove it");
        return Vec::new();
    }
    if given.value.is_empty() || given.value.len() > GRID_POINTS_MAX {
        let message = format!("a grid of {} points", given.value.len());
        faults.add(given.at, message, format!("1 to {GRID_POINTS_MAX}"));
        return Vec::new();
    }
    let Some(p) = numbers else { return Vec::new() };
    let outside = given
        .value
        .iter()
        .find(|g| !(p.lower..=p.upper).contains(*g));
    if let Some(value) = outside {
        let cure = format!("between {} and {}", p.lower, p.upper);
        faults.add(
            given.at,
            format!("grid point {value} is outside the bounds"),
            cure,
        );
    }
    given.value
}

/// The states, those that can be read.
pub(super) fn states(tables: Vec<Table<'_>>, faults: &mut Faults) -> Vec<OwnedState> {
    if tables.len() > STATES_MAX {
        let message = format!("{} states", tables.len());
        faults.add(
            tables[STATES_MAX].at,
            message,
            format!("at most {STATES_MAX}"),
        );
    }
    let tables = tables.into_iter().take(STATES_MAX);
    let found: Vec<OwnedState> = tables.filter_map(|t| state(t, faults)).collect();
    for (k, s) in found.iter().enumerate() {
        if found[..k].iter().any(|q| q.name.value == s.name.value) {
            let message = format!("state `{}` appears twice", s.name.value);
            faults.add(s.name.at, message, "rename one");
        }
    }
    found
}

fn state(mut table: Table<'_>, faults: &mut Faults) -> Option<OwnedState> {
    let name = table.needed_text("name", "what the expressions call it", faults);
    let unit = table.needed_text("unit", UNITS, faults);
    let initial = table.needed_text("initial", "an expression for its value at rest", faults);
    let derivative = table.needed_text("derivative", "an expression for its change per s", faults);
    table.finish(faults);
    let name = name?;
    identifier(&name, "state name", faults);
    if is_reserved(&name.value) {
        let message = format!("`{}` is a variable or function already", name.value);
        faults.add(name.at, message, "choose another name");
    }
    let measure = unit.as_ref().map(|unit| measure(unit, faults));
    Some(OwnedState {
        measure: measure.unwrap_or(Unit::UNKNOWN),
        name,
        unit: unit.map_or_else(String::new, |unit| unit.value),
        initial,
        derivative,
    })
}

/// What expressions may call parameters and states.
pub(super) fn symbols(
    parameters: &[OwnedParameter],
    states: &[OwnedState],
    faults: &mut Faults,
) -> Vec<Symbol> {
    let of_parameters = parameters.iter().enumerate().map(|(k, p)| {
        let operation = Operation::Parameter(narrow(k));
        (p.symbol.clone(), operation, p.measure, p.at)
    });
    let of_states = states.iter().enumerate().map(|(k, s)| {
        let operation = Operation::State(narrow(k));
        (s.name.value.clone(), operation, s.measure, s.name.at)
    });
    let mut found: Vec<Symbol> = Vec::new();
    for (name, operation, unit, at) in of_parameters.chain(of_states) {
        let mut unit = unit;
        if let Some(other) = found.iter_mut().find(|s| s.name == name) {
            let message = format!("`{name:.60}` stands for two things");
            faults.add(at, message, "rename one");
            // Which of them an expression means is not known.
            (unit, other.unit) = (Unit::UNKNOWN, Unit::UNKNOWN);
        }
        found.push(Symbol {
            name,
            operation,
            unit,
        });
    }
    found
}
