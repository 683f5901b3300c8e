//! `gantry-tau labcomm`.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, StdoutLock, Write};
use std::process::ExitCode;

use clap::{Args, Subcommand, ValueEnum};
use gantry_tau_labcomm::Version;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_record::labcomm::{EncodeError, decode, encode, schema};

use super::outputs::{InputFile, NamedInput};
use super::{Failure, MachineCommand, Outcome, run_on};

/// LabComm streams as JSON lines, JSON lines as streams, and the schema of gantry-tau's samples
///
/// LabComm is the format of the thesis' sensors and tools; docs/labcomm.md describes it.
#[derive(Debug, Args)]
pub(crate) struct Labcomm {
    #[command(subcommand)]
    command: LabcommCommand,
}

#[derive(Debug, Subcommand)]
enum LabcommCommand {
    Decode(Decode),
    Encode(Encode),
    Schema(Schema),
}

/// Print a stream or recording of either version as JSON lines, one per event
///
/// {"at":0,"version":"LabComm2014.v1"},
/// {"at":17,"define":"data","index":64,"type":["array",[3],"int"]},
/// {"at":50,"sample":"data","index":64,"value":[42,-7,2000000]}. Text that is not UTF-8 is
/// {"bytes":"hex"}; a float that is not finite is "nan", "inf" or "-inf"; {"skip":4} is a packet
/// that was skipped.
///
/// Exit codes: 0 the stream ends between two events; 1 an error, which is the last line:
/// {"at":64,"error":{"kind":..., "message":...}}, kind one of incomplete, malformed, version,
/// unknown_index, conflict, limit; 2 usage.
#[derive(Debug, Args)]
struct Decode {
    /// Print floats and doubles as the hex of their bits
    #[arg(long)]
    bits: bool,
    /// Stream or recording; standard input if absent
    #[arg(value_name = "FILE")]
    file: Option<InputFile>,
}

/// Write JSON lines, as `decode` prints them, as a stream to standard output
///
/// The keys "define", "type", "sample", "value" and "index" count; "index" may be absent, and "at"
/// is ignored. Lines with "version", "skip" or "reference" are passed over.
///
/// Exit codes: 0 all lines are written; 1 a line cannot be encoded, which the message names; 2
/// usage.
#[derive(Debug, Args)]
struct Encode {
    /// Version to write
    #[arg(long, value_name = "VERSION", default_value = "2006")]
    version: LabcommVersion,
    /// JSON lines; standard input if absent
    #[arg(value_name = "FILE")]
    file: Option<InputFile>,
}

/// Print the samples of gantry-tau as a text that LabComm's compiler takes
#[derive(Debug, Args)]
struct Schema {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    robot: NamedInput,
}

/// Version of the format.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum LabcommVersion {
    /// Numbers of 32 bits, no version text: what the thesis' programs speak
    #[value(name = "2006")]
    V2006,
    /// "LabComm2014.v1", the present one
    #[value(name = "2014")]
    V2014,
    /// "LabComm2014", of the releases v2014.0 to v2014.4
    #[value(name = "2014.0")]
    V2014Release,
}

impl From<LabcommVersion> for Version {
    fn from(version: LabcommVersion) -> Self {
        match version {
            LabcommVersion::V2006 => Self::V2006,
            LabcommVersion::V2014 => Self::V2014,
            LabcommVersion::V2014Release => Self::V2014_0,
        }
    }
}

impl Labcomm {
    pub(crate) fn run(self) -> Outcome {
        match self.command {
            LabcommCommand::Decode(decode) => decode.run(),
            LabcommCommand::Encode(encode) => encode.run(),
            LabcommCommand::Schema(schema) => run_on(AnyRobotFile::named(&schema.robot), schema),
        }
    }
}

impl Decode {
    fn run(self) -> Outcome {
        let outcome = decode(input(self.file)?, output(), self.bits);
        until_the_reader_ends(outcome.map(|is_whole| ExitCode::from(u8::from(!is_whole))))
    }
}

impl Encode {
    fn run(self) -> Outcome {
        let input = input(self.file)?;
        let name = input.name.clone();
        match encode(self.version.into(), BufReader::new(input), output()) {
            Ok(()) => Ok(ExitCode::SUCCESS),
            Err(EncodeError::Io(error)) => until_the_reader_ends(Err(error)),
            Err(error @ EncodeError::Line { .. }) => Err(format!("{name}: {error}").into()),
        }
    }
}

impl MachineCommand for Schema {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        _: RobotFile<K, N>,
    ) -> Outcome {
        let mut output = output();
        let written = output
            .write_all(schema::<N>().as_bytes())
            .and_then(|()| output.flush());
        until_the_reader_ends(written.map(|()| ExitCode::SUCCESS))
    }
}

/// Takes the end of the output's reader, for instance `head`, for the end of the command.
pub(super) fn until_the_reader_ends(outcome: io::Result<ExitCode>) -> Outcome {
    match outcome {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(ExitCode::SUCCESS),
        outcome => Ok(outcome?),
    }
}

/// A file or stream whose errors name it.
struct Named<T> {
    name: String,
    inner: T,
}

impl<T> Named<T> {
    fn named(&self, error: &io::Error) -> io::Error {
        io::Error::new(error.kind(), format!("{}: {error}", self.name))
    }
}

impl<R: Read> Read for Named<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.inner.read(bytes).map_err(|error| self.named(&error))
    }
}

impl<W: Write> Write for Named<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.inner.write(bytes).map_err(|error| self.named(&error))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush().map_err(|error| self.named(&error))
    }
}

/// A file, or standard input.
fn input(file: Option<InputFile>) -> Result<Named<Box<dyn Read>>, Failure> {
    let Some(path) = file else {
        return Ok(Named {
            name: "standard input".to_owned(),
            inner: Box::new(io::stdin().lock()),
        });
    };
    let name = path.display().to_string();
    match File::open(&*path) {
        Ok(file) => Ok(Named {
            name,
            inner: Box::new(file),
        }),
        Err(error) => Err(format!("{name}: cannot be opened: {error}").into()),
    }
}

/// Standard output.
fn output() -> BufWriter<Named<StdoutLock<'static>>> {
    BufWriter::new(Named {
        name: "standard output".to_owned(),
        inner: io::stdout().lock(),
    })
}
