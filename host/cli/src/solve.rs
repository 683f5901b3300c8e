//! `solve`: JSON lines in, JSON lines out, for scripts in any language.
//!
//! Request: `{"id": any, "robot": "l2", "op": "...", ...}`; the robot is `l2` or `f1` (built in),
//! the path of a robot file, or an inline object.
//! Answer: `{"id": any, "ok": {...}}` or `{"id": any, "error": {"kind": "...", "message": "..."}}`.
//! Every line gets one answer, in order, flushed; a line that cannot be read is answered with an
//! error.
//!
//! | op | request | answer |
//! |---|---|---|
//! | `ik` | `T`, `R`?, `seed: q`? | `q`, `iterations`, `residual` |
//! | `fk` | `q`, `seed: {T, R}`? | `T`, `R`, `iterations`, `residual` |
//! | `jacobian` | `T`, `R`? | `J` |
//! | `statics` | `T`, `R`?, `w` | `f`, `tau` |
//! | `compliance` | `T`, `R`? | `C` |
//! | `deflection` | `T`, `R`?, `w` | `r`, `dx_links`, `dx_total` |
//! | `compensate` | `T`, `R`?, `w` | `q` |
//! | `dynamics` | `tcp_m`, `rotation`?, `axes`?, `drives`?, `nu`?, `wrench`? | `mass_matrix`, `accelerations`, `link_tensions`, `sensor_load` |
//! | `modes` | `tcp_m`, `rotation`?, `axes`? | `first_five_modes_hz` |
//! | `loop` | as `modes`, `filter`, `drives`?, `latency_cycles`?, `position_gain`? | `closed_loop_growth_per_s`, `at_hz`, `any_phase_margin`, `margin_at_hz` |
//!
//! The last three take `masses`, `tool_kg` and `damping_ratio` too; by default they are those of the
//! robot file.
//!
//! SI units, q-units for `q` and `r`; matrices by rows. `R` is the identity by default. Model `l2`
//! (3 axes) is solved in closed form: a `seed` is read and not needed (for `fk`, an `R`, or that of
//! the seed, is the orientation). Model `f1` (6 axes) iterates: plates start from the seed's `q_4`,
//! `q_5`, `q_6` or from 0, the tool from the seed's pose or from the synchronised form.

mod dynamics;
mod f1;
mod l2;
mod ops;
mod request;

use std::collections::HashMap;
use std::io::{self, BufRead, Write};

use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_system::lines::{Line, read_line};
use serde_json::{Value, json};

use dynamics::Bodies;
use request::SolvedMachine;

/// Longest line that is read, in bytes, without its end.
pub const MAX_LINE: usize = 1 << 20;
/// Largest number of robot files that are kept.
const MAX_CACHED: usize = 64;

/// Reason why a request has no result.
#[derive(Clone, Debug, PartialEq, Eq)]
struct SolveError {
    /// Class of the error: that of core
    /// ([`gantry_tau_core::model::kinematics::KinematicsError::kind`]), or one of two more.
    kind: &'static str,
    message: String,
}

impl SolveError {
    fn request(message: impl Into<String>) -> Self {
        Self {
            kind: "bad_request",
            message: message.into(),
        }
    }

    fn robot(message: impl Into<String>) -> Self {
        Self {
            kind: "bad_robot",
            message: message.into(),
        }
    }

    fn answer(&self, id: Value) -> String {
        json!({"id": id, "error": {"kind": self.kind, "message": self.message}}).to_string()
    }
}

/// Reads requests until the input ends, and answers each.
///
/// # Errors
/// Error of input or output. An invalid line is not an error here.
pub fn run(mut input: impl BufRead, mut output: impl Write) -> io::Result<()> {
    let mut solver = Solver::default();
    let mut line = Vec::new();
    loop {
        let answer = match read_line(&mut input, &mut line, MAX_LINE)? {
            Line::End => return Ok(()),
            Line::TooLong => SolveError::request(format!("line is longer than {MAX_LINE} bytes"))
                .answer(Value::Null),
            Line::Complete => match std::str::from_utf8(&line) {
                Ok(text) => solver.answer(text),
                Err(_) => SolveError::request("line is not UTF-8").answer(Value::Null),
            },
        };
        output.write_all(answer.as_bytes())?;
        output.write_all(b"\n")?;
        output.flush()?;
    }
}

/// Answers one request.
#[must_use]
pub fn answer(line: &str) -> String {
    Solver::default().answer(line)
}

/// State kept between requests: robots by their path.
#[derive(Default)]
struct Solver {
    files: HashMap<String, SolvedMachine>,
}

impl Solver {
    fn answer(&mut self, line: &str) -> String {
        let request: Value = match serde_json::from_str(line) {
            Ok(request) => request,
            Err(error) => {
                return SolveError::request(format!("line is not JSON: {error}"))
                    .answer(Value::Null);
            }
        };
        let id = request.get("id").cloned().unwrap_or(Value::Null);
        match self.solve(&request) {
            Ok(result) => json!({"id": id, "ok": result}).to_string(),
            Err(failure) => failure.answer(id),
        }
    }

    fn solve(&mut self, request: &Value) -> Result<Value, SolveError> {
        if !request.is_object() {
            return Err(SolveError::request("request is not an object"));
        }
        let op = match request.get("op") {
            Some(Value::String(op)) => op.as_str(),
            Some(_) => return Err(SolveError::request("op is not a string")),
            None => return Err(SolveError::request("op is missing")),
        };
        if !ops::NAMES.contains(&op) {
            let names = ops::NAMES.join(", ");
            return Err(SolveError::request(format!(
                "op is {op:?}; expected one of {names}"
            )));
        }
        let machine = match request.get("robot") {
            Some(Value::String(path)) => self.file(path)?,
            Some(robot @ Value::Object(_)) => request::inline(robot)?,
            Some(_) => {
                return Err(SolveError::request(
                    "robot is neither an object nor a name or path",
                ));
            }
            None => return Err(SolveError::request("robot is missing")),
        };
        ops::solve(op, &machine, request)
    }

    /// Returns the robot of a file, read once. A file that was refused is read again next time.
    fn file(&mut self, path: &str) -> Result<SolvedMachine, SolveError> {
        if let Some(machine) = self.files.get(path) {
            return Ok(*machine);
        }
        let file =
            AnyRobotFile::named(path).map_err(|error| SolveError::robot(error.to_string()))?;
        let machine = match file {
            AnyRobotFile::L2(file) => SolvedMachine::L2 {
                robot: *file.model.robot(),
                compliances: file.compliances,
                bodies: Bodies::of(&file),
            },
            AnyRobotFile::F1(file) => SolvedMachine::F1 {
                kinematics: file.model,
                compliances: file.compliances,
                bodies: Bodies::of(&file),
            },
        };
        if self.files.len() >= MAX_CACHED {
            self.files.clear();
        }
        self.files.insert(path.to_owned(), machine);
        Ok(machine)
    }
}
