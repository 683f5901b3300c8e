//! Stub.
use super::PlanError;
use super::springs::Judgement;
use crate::measurements::springs::Setup;
use crate::robot_file::RobotFile;
pub(super) fn straps<K, const N: usize>(
    _: &RobotFile<K, N>,
    _: &Setup,
    _: &Judgement,
    _: &str,
) -> Result<String, PlanError> {
    Ok(String::new())
}
