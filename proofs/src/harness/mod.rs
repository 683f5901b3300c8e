//! Kani harnesses, one file per family; each hands anything there is to a property function.
//!
//! Every assumption is followed by a cover, and every harness ends with one: what cannot be reached proves nothing.
//! The runner compiles one family at a time (`cfg(only)`): Kani translates and links every harness it finds, on every run.

#[cfg(any(not(only), only = "axis"))]
mod axis;
#[cfg(any(not(only), only = "blackbox"))]
mod blackbox;
#[cfg(any(not(only), only = "channel"))]
mod channel;
#[cfg(any(not(only), only = "client"))]
mod client;
#[cfg(any(not(only), only = "compensation"))]
mod compensation;
#[cfg(any(not(only), only = "crossing"))]
mod crossing;
#[cfg(any(not(only), only = "fsm"))]
mod fsm;
#[cfg(any(not(only), only = "ingress"))]
mod ingress;
#[cfg(any(not(only), only = "kinematics"))]
mod kinematics;
#[cfg(any(not(only), only = "monitor"))]
mod monitor;
#[cfg(any(not(only), only = "motors"))]
mod motors;
#[cfg(any(not(only), only = "session"))]
mod session;
#[cfg(any(not(only), only = "total"))]
mod total;
#[cfg(any(not(only), only = "wire"))]
mod wire;
