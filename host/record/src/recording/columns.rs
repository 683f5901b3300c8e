//! Columns of the recordings of server and client, units in their names `[T 5.1.2]`.

use gantry_tau_core::control::message::{AxisState, State};
use gantry_tau_core::units::OffsetNm;
use gantry_tau_labcomm::samples::Tool;
use gantry_tau_server::plant::DriveState;
use gantry_tau_server::publication::Samples;
use gantry_tau_server::record::TickRecord;

use super::{CsvRecord, TickRow};

const LOAD: [&str; 6] = [
    "force_x_n",
    "force_y_n",
    "force_z_n",
    "moment_x_n_m",
    "moment_y_n_m",
    "moment_z_n_m",
];

/// Name and value of a column.
type Column = (&'static str, fn(&AxisState) -> i64);

/// Columns of an axis, whose number stands for `{}`.
const AXIS: [Column; 9] = [
    ("nominal_{}_nm", |axis| axis.nominal.0),
    ("offset_{}_nm", |axis| axis.offsets.position.0.into()),
    ("velocity_offset_{}_um_s", |axis| {
        axis.offsets.velocity.0.into()
    }),
    ("torque_offset_{}_permille", |axis| {
        axis.offsets.torque.0.into()
    }),
    ("shadow_{}_nm", |axis| axis.shadow.position.0.into()),
    ("actual_{}_nm", |axis| axis.actual.position.0),
    ("actual_velocity_{}_um_s", |axis| {
        axis.actual.velocity.0.into()
    }),
    ("actual_torque_{}_permille", |axis| {
        axis.actual.torque.0.into()
    }),
    ("flags_{}", |axis| axis.flags.bits().into()),
];

/// Columns common to all recordings, from the State.
fn state_header(axes: usize) -> Vec<String> {
    let mut header: Vec<String> = [
        "tick",
        "time_s",
        "state",
        "cause",
        "missed",
        "ramp_ticks_left",
    ]
    .map(str::to_owned)
    .into();
    for axis in 1..=axes {
        header.extend(AXIS.map(|(name, _)| name.replace("{}", &axis.to_string())));
    }
    header
}

fn state_fields<const N: usize>(state: &State<N>) -> Vec<String> {
    let mut fields = vec![
        state.tick.0.to_string(),
        seconds(state.tick.0),
        state.phase.name().to_owned(),
        state.cause.name().to_owned(),
        state.counters.missed.to_string(),
        state.ramp_ticks_left.to_string(),
    ];
    for axis in &state.axes {
        fields.extend(AXIS.map(|(_, value)| value(axis).to_string()));
    }
    fields
}

/// Time of a tick, s since the server started: a tick is 1 ms of its own time, in lock-step too.
fn seconds(tick: u64) -> String {
    format!("{}.{:03}", tick / 1_000, tick % 1_000)
}

/// Names of a vector's three columns; the axis stands for `{}`.
fn vector(name: &str) -> [String; 3] {
    ["x", "y", "z"].map(|axis| name.replace("{}", axis))
}

/// Values in millionths of their units; without instruments at the tool their columns are empty.
fn millionths(values: Option<[f64; 3]>) -> [String; 3] {
    values.map_or_else(Default::default, |values| {
        values.map(|value| (value * 1e6).to_string())
    })
}

/// The server's recording.
impl<const N: usize> CsvRecord for TickRecord<N> {
    fn header() -> Vec<String> {
        let mut header = state_header(N);
        header.extend((1..=N).map(|axis| format!("reference_{axis}_nm")));
        header.extend(LOAD.map(str::to_owned));
        header.extend(vector("displacement_{}_um"));
        header.extend(vector("gauge_{}_um"));
        header.extend(["elapsed_ticks", "round_trip_us"].map(str::to_owned));
        header.extend(vector("turn_{}_urad"));
        header.extend((1..=N).map(|axis| format!("drive_{axis}")));
        header
    }

    fn fields(&self) -> Vec<String> {
        let mut fields = state_fields(&self.state);
        fields.extend(self.references.iter().map(|r| r.position.0.to_string()));
        fields.extend(self.tool.map_or_else(Default::default, |tool| {
            tool.load.map(|value| value.to_string())
        }));
        fields.extend(millionths(self.tool.map(|tool| tool.displacement_m)));
        fields.extend(millionths(self.tool.map(|tool| tool.gauges_m)));
        fields.push(self.elapsed.to_string());
        fields.push(
            self.round_trip_us
                .map_or_else(String::new, |time| time.to_string()),
        );
        fields.extend(millionths(self.tool.map(|tool| tool.turn_rad)));
        // Empty for a machine that does not tell.
        let drives = self
            .drives
            .map(|drives| drives.map(DriveState::name))
            .unwrap_or([""; N]);
        fields.extend(drives.map(str::to_owned));
        fields
    }
}

impl<const N: usize> TickRow<N> for TickRecord<N> {
    fn samples(&self) -> Samples<N> {
        self.into()
    }
}

/// One tick of the client.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClientRow<const N: usize> {
    /// State that was answered.
    pub state: State<N>,
    /// Position offsets that were requested.
    pub targets: [OffsetNm; N],
    /// Axes whose correction was cut at the limit of its offset.
    pub saturated: [bool; N],
    /// Load on the tool as it computed with, tared and filtered: force (N) and moment (N m), world
    /// axes.
    pub load: [f64; 6],
}

impl<const N: usize> ClientRow<N> {
    /// References of the server, nm, as its State tells them.
    fn references_nm(&self) -> [i64; N] {
        self.state.axes.map(|axis| {
            axis.nominal
                .0
                .saturating_add(axis.offsets.position.0.into())
        })
    }
}

/// The tool has the load alone: a client does not know its displacement, which is not a number.
impl<const N: usize> TickRow<N> for ClientRow<N> {
    fn samples(&self) -> Samples<N> {
        let unknown = [f64::NAN; 3];
        let tick = i64::try_from(self.state.tick.0).unwrap_or(i64::MAX);
        let tool = Tool {
            tick,
            step: 0,
            load: self.load,
            displacement_m: unknown,
            turn_rad: unknown,
            gauges_m: unknown,
        };
        Samples::new(&self.state, &self.references_nm(), Some(tool))
    }
}

/// The client's recording: references and actual values as reported by the server `[T 5.1.2]`, and
/// the requested offsets.
impl<const N: usize> CsvRecord for ClientRow<N> {
    fn header() -> Vec<String> {
        let mut header = state_header(N);
        header.extend((1..=N).map(|axis| format!("reference_{axis}_nm")));
        header.extend((1..=N).map(|axis| format!("target_{axis}_nm")));
        header.extend(LOAD.map(str::to_owned));
        header.push("saturated_axes".to_owned());
        header
    }

    fn fields(&self) -> Vec<String> {
        let mut fields = state_fields(&self.state);
        fields.extend(self.references_nm().map(|reference| reference.to_string()));
        fields.extend(self.targets.iter().map(|target| target.0.to_string()));
        fields.extend(self.load.map(|value| value.to_string()));
        // One bit per axis, the first axis lowest.
        let bits = self.saturated.iter().rev();
        fields.push(
            bits.fold(0_u32, |bits, cut| 2 * bits + u32::from(*cut))
                .to_string(),
        );
        fields
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::message::Phase;
    use gantry_tau_core::units::{PositionNm, Tick};

    use super::*;

    fn state(axes: [AxisState; 3]) -> State<3> {
        State {
            tick: Tick(7),
            phase: Phase::Obtain,
            axes,
            ..TickRecord::listening().state
        }
    }

    #[test]
    fn every_column_of_a_client_has_its_value() {
        let mut axes = [AxisState::default(); 3];
        for (axis, nm) in axes.iter_mut().zip([1_000, -2_000, 3_000]) {
            axis.nominal = PositionNm(nm);
            axis.offsets.position = OffsetNm(i32::try_from(nm / 100).unwrap());
        }
        let targets = [OffsetNm(-31), OffsetNm(32), OffsetNm(-33)];
        let load = [41.0, -42.5, 43.0, 0.5, -0.25, 0.125];
        let row = ClientRow {
            state: state(axes),
            targets,
            saturated: [false, true, false],
            load,
        };
        let header = ClientRow::<3>::header();
        let expected = [
            ("tick", "7"),
            ("reference_1_nm", "1010"),
            ("reference_2_nm", "-2020"),
            ("reference_3_nm", "3030"),
            ("target_1_nm", "-31"),
            ("target_2_nm", "32"),
            ("target_3_nm", "-33"),
            ("force_x_n", "41"),
            ("force_y_n", "-42.5"),
            ("force_z_n", "43"),
            ("moment_x_n_m", "0.5"),
            ("moment_y_n_m", "-0.25"),
            ("moment_z_n_m", "0.125"),
            ("saturated_axes", "2"),
        ];
        let fields = row.fields();
        for (column, value) in expected {
            let place = header
                .iter()
                .position(|name| name == column)
                .unwrap_or_else(|| panic!("{column}: {header:?}"));
            assert_eq!(fields[place], value, "{column}");
        }
        // Of its tool a client knows the load alone.
        let tool = row.samples().tool.unwrap();
        assert_eq!((tool.tick, tool.step, tool.load), (7, 0, load));
        for unknown in [tool.displacement_m, tool.turn_rad, tool.gauges_m] {
            assert!(unknown.iter().all(|value| value.is_nan()), "{tool:?}");
        }
    }

    #[test]
    fn every_saturated_axis_has_its_bit() {
        let state = state([AxisState::default(); 3]);
        let header = ClientRow::<3>::header();
        for (saturated, bits) in [
            ([false; 3], "0"),
            ([true, false, false], "1"),
            ([true, false, true], "5"),
        ] {
            let row = ClientRow {
                state,
                targets: [OffsetNm(0); 3],
                saturated,
                load: [0.0; 6],
            };
            let fields = row.fields();
            assert_eq!(fields.len(), header.len());
            assert_eq!(
                (header.last(), fields.last()),
                (Some(&"saturated_axes".to_owned()), Some(&bits.to_owned()))
            );
        }
    }
}
