//! Tables 5.1 to 5.3 of the thesis. It calls them spring constants; they are compliances, and those
//! of links are negative where the platform turned. The unit of the scale behind Table 5.3 is not
//! stated.

use gantry_tau_core::model::l2::AXES;

/// Values of a table, µm/N.
pub(super) struct Printed {
    pub(super) table: &'static str,
    pub(super) values: &'static [f64],
}

/// Carts of the L2.
const L2_CARTS: [Printed; 1] = [Printed {
    table: "Table 5.1",
    values: &[0.0406, 0.0509, 0.0600],
}];
/// Links of the L2: left column, before the jump near 360 N, and right column, after it.
const L2_LINKS: [Printed; 2] = [
    Printed {
        table: "Table 5.2, used",
        values: &[-0.6351, 1.8024, -0.5799, -12.0260, 8.7635, 4.4191],
    },
    Printed {
        table: "Table 5.2, after",
        values: &[-0.3271, 0.7700, -0.2478, -7.4292, 5.3801, 2.7638],
    },
];
/// Carts of the F1.
const F1_CARTS: [Printed; 1] = [Printed {
    table: "Table 5.3",
    values: &[4.2081, 7.5215, 5.5578],
}];

/// Tables of the links of a machine with `N` axes.
pub(super) const fn links<const N: usize>() -> &'static [Printed] {
    if N == AXES { &L2_LINKS } else { &[] }
}

/// Tables of the axes of a machine with `N` axes: of its carts.
pub(super) const fn axes<const N: usize>() -> &'static [Printed] {
    if N == AXES { &L2_CARTS } else { &F1_CARTS }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_those_of_the_data() {
        let data: toml::Table = include_str!("../../../../../tests/data/thesis_tables.toml")
            .parse()
            .unwrap();
        let carts = ["cart1", "cart2", "cart3"];
        let names = ["link11", "link21", "link22", "link31", "link32", "link33"];
        let [l2, f1] = [&data["l2"], &data["f1"]];
        assert_eq!(axes::<3>()[0].values, numbers(&l2["cart"], &carts));
        assert_eq!(axes::<6>()[0].values, numbers(&f1["cart"], &carts));
        assert_eq!(links::<3>()[0].values, numbers(&l2["link"]["used"], &names));
        assert_eq!(
            links::<3>()[1].values,
            numbers(&l2["link"]["after"], &names)
        );
        assert!(links::<6>().is_empty());
    }

    fn numbers(table: &toml::Value, names: &[&str]) -> Vec<f64> {
        names
            .iter()
            .map(|name| table[*name].as_float().unwrap())
            .collect()
    }
}
