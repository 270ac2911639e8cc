//! Units of length. Everything behind the readers is in metres.

/// A unit of length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// The name users type.
    pub name: &'static str,
    /// Its length in metres.
    pub metres: f64,
}

/// Every unit that has a name.
pub static ALL: [Unit; 6] = [
    Unit { name: "m", metres: 1.0 },
    Unit { name: "cm", metres: 0.01 },
    Unit { name: "mm", metres: 0.001 },
    Unit { name: "km", metres: 1000.0 },
    Unit { name: "ft", metres: 0.3048 },
    Unit { name: "in", metres: 0.0254 },
];

/// The unit of that name.
pub fn named(name: &str) -> Option<&'static Unit> {
    ALL.iter().find(|unit| unit.name == name)
}

/// The names, for messages: `m, cm, mm, …`.
pub fn names() -> String {
    ALL.map(|unit| unit.name).join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_inches_are_a_foot_and_names_are_unique() {
        let metres = |name| named(name).expect("known").metres;
        assert!((12.0 * metres("in") - metres("ft")).abs() < 1e-15);
        assert!(ALL.iter().all(|unit| named(unit.name) == Some(unit)));
        assert_eq!(named("furlong"), None);
    }
}
