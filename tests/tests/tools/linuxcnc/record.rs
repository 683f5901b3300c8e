//! The sampler's record: one row per servo period.

/// One servo period.
#[derive(Debug)]
pub(super) struct Row {
    /// `joint.N.motor-pos-cmd`, mm and degrees.
    pub(super) joints: Vec<f64>,
    /// `axis.L.pos-cmd`, mm and degrees.
    pub(super) axes: Vec<f64>,
    /// `motion.motion-enabled`.
    pub(super) is_on: bool,
    /// `motion.coord-mode`: a program moves the tool.
    pub(super) is_world: bool,
    /// `gantrytaukins.refused`.
    pub(super) refused: u32,
    /// `gantrytaukins.residual`, m.
    pub(super) residual_m: f64,
}

/// All rows of a run; none is missing.
pub(super) struct Record(pub(super) Vec<Row>);

impl Record {
    /// Parses the output of `halsampler -t`. The last line may be cut.
    pub(super) fn parse(text: &str) -> Self {
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        let rows = whole.lines().enumerate().map(|(number, line)| {
            assert!(!line.contains("overrun"), "row {number}: {line}");
            let mut fields = line.split_whitespace();
            assert_eq!(fields.next().unwrap().parse(), Ok(number), "a row is missing");
            row(&fields.collect::<Vec<_>>())
        });
        Self(rows.collect())
    }
}

fn row(fields: &[&str]) -> Row {
    let number = |text: &&str| text.parse::<f64>().unwrap();
    let [positions @ .., residual, is_on, is_world, refused] = fields else { panic!("{fields:?}") };
    let (joints, axes) = positions.split_at(positions.len() / 2);
    Row {
        joints: joints.iter().map(number).collect(),
        axes: axes.iter().map(number).collect(),
        is_on: *is_on == "1",
        is_world: *is_world == "1",
        refused: refused.parse().unwrap(),
        residual_m: number(residual),
    }
}
