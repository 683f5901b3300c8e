//! Recordings of one run in every format: equal field by field.

mod compare;
mod killed;
mod labcomm;
mod mcap;
mod monitor;
mod session;

use gantry_tau::record::RecordTo;

use crate::process::Folder;

fn to(folder: &Folder, name: &str) -> RecordTo {
    folder.path(name).to_str().unwrap().parse().unwrap()
}
