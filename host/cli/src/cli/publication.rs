//! Options of `serve` for its LabComm ports.

use std::net::SocketAddr;

use clap::Args;
use gantry_tau_labcomm::Version;
use gantry_tau_record::recording::RecordTo;
use gantry_tau_server::links::Allowed;
use gantry_tau_server::publication::{MachineIdentity, Publication, SampleName};
use gantry_tau_server::server::ServerError;

use super::labcomm::LabcommVersion;
use super::{OptionError, address};

/// Ports, and what they speak.
#[derive(Debug, Args)]
pub(crate) struct PublicationOptions {
    /// Publish samples over LabComm, one of each per tick: any of data, forcesensor, state, axes,
    /// tool, session_event, drives, machine (repeatable) [default names: data,forcesensor]
    ///
    /// A reader gets the definitions, then the samples; at most four readers at a time, and one
    /// that does not keep up is dropped. A port with data and forcesensor alone is written in the
    /// cycle, before the State of the tick; any other some milliseconds later.
    /// `gantry-tau labcomm schema` prints the types.
    #[arg(long, value_name = "HOST:PORT[=NAME,..]", value_parser = port)]
    labcomm: Vec<Port>,
    /// Version of LabComm on these ports, and in a recording [default: 2006 on ports, 2014 in a
    /// recording]
    #[arg(long, value_name = "VERSION", requires = "labcomm_streams")]
    labcomm_version: Option<LabcommVersion>,
}

impl PublicationOptions {
    /// Addresses of the ports.
    pub(super) fn addresses(&self) -> impl Iterator<Item = SocketAddr> {
        self.labcomm.iter().map(|port| port.address)
    }

    /// The file of a recording, in this version.
    pub(super) fn recorded(&self, to: &RecordTo) -> RecordTo {
        match self.labcomm_version {
            Some(version) => to.clone().with_version(version.into()),
            None => to.clone(),
        }
    }

    /// Listens on all ports, for a machine with `N` axes.
    pub(super) fn bind<const N: usize>(
        &self,
        allowed: &Allowed,
        machine: &MachineIdentity,
        gauge_resolution_m: f64,
    ) -> Result<Vec<Publication>, ServerError> {
        let version = self.labcomm_version.map_or(Version::V2006, Version::from);
        self.labcomm
            .iter()
            .map(|port| {
                Publication::bind::<N>(port.address, version, &port.names, gauge_resolution_m)
                    .map(|publication| publication.for_peers(allowed.clone()).of_machine(machine))
                    .map_err(|error| ServerError::listen(port.address, &error))
            })
            .collect()
    }
}

/// A port and its samples, each once.
#[derive(Clone, Debug)]
struct Port {
    address: SocketAddr,
    names: Vec<SampleName>,
}

fn port(text: &str) -> Result<Port, OptionError> {
    let (at, listed) = text.split_once('=').unwrap_or((text, "data,forcesensor"));
    let mut names = Vec::new();
    for name in listed.split(',') {
        let name = name.trim().parse()?;
        if names.contains(&name) {
            return Err(format!("sample {name} is named twice").into());
        }
        names.push(name);
    }
    Ok(Port {
        address: address(at)?,
        names,
    })
}
