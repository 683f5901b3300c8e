//! Recordings of one run in every format: equal field by field.

mod killed;
mod labcomm;
pub(crate) mod mcap;
mod monitor;

use gantry_tau_record::recording::RecordTo;

use crate::process::Folder;

fn to(folder: &Folder, name: &str) -> RecordTo {
    folder.path(name).to_str().unwrap().parse().unwrap()
}
