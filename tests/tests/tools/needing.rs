//! Trials that need a tool.

use libtest_mimic::{Failed, Trial};

/// Makes a trial. Where a tool is missing it is reported as ignored, with the name of the tool; where
/// the variable `required_by` is 1 it fails instead.
pub(crate) fn trial(
    name: String,
    missing: Option<String>,
    required_by: &str,
    body: impl FnOnce() -> Result<(), Failed> + Send + 'static,
) -> Trial {
    let Some(missing) = missing else {
        return Trial::test(name, body);
    };
    if std::env::var_os(required_by).is_some_and(|value| value == "1") {
        let failed = Failed::from(&missing);
        return Trial::test(name, || Err(failed)).with_kind(missing);
    }
    Trial::test(name, body)
        .with_kind(missing)
        .with_ignored_flag(true)
}
