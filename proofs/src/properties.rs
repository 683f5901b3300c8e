//! The properties, one module per family.

pub mod agitation;
pub mod axis;
pub mod blackbox;
#[cfg(feature = "capi")]
pub mod capi;
pub mod channel;
pub mod client;
pub mod compensation;
pub mod crossing;
pub mod drive;
pub mod endpoint;
pub mod fsm;
pub mod ingress;
#[cfg(feature = "keys")]
pub mod keys;
pub mod kinematics;
#[cfg(any(feature = "labcomm", feature = "labcomm_decoder"))]
pub mod labcomm;
pub mod monitor;
pub mod motors;
#[cfg(feature = "pacer")]
pub mod pacer;
#[cfg(feature = "position_loop")]
pub mod position_loop;
pub mod session;
pub mod six_link;
pub mod tick;
pub mod wire;
