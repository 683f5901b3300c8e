//! The archive. It has no times, so that the same unit is the same file.

use std::io::{Cursor, Write};

use gantry_tau_fmi::kind::Kind;
use gantry_tau_fmi::resources::ROBOT_FILE;
use zip::result::ZipResult;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::library::Library;

/// Returns the bytes of the archive. The libraries come last: the first bytes then show the names of all
/// files.
pub(super) fn archive(
    kind: Kind,
    description: &str,
    robot_text: &str,
    libraries: &[Library],
) -> ZipResult<Vec<u8>> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .unix_permissions(0o644);
    let mut add = |path: &str, bytes: &[u8]| {
        archive.start_file(path, options)?;
        archive.write_all(bytes)?;
        ZipResult::Ok(())
    };
    add("modelDescription.xml", description.as_bytes())?;
    add(&format!("resources/{ROBOT_FILE}"), robot_text.as_bytes())?;
    let identifier = kind.model_identifier();
    for library in libraries {
        let (folder, extension) = (library.platform.folder(), library.platform.extension());
        let path = format!("binaries/{folder}/{identifier}.{extension}");
        add(&path, &library.bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}
