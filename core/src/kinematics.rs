//! Nominal kinematics of the 3-DOF Gantry-Tau.
