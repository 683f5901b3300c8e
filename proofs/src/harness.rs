//! Kani harnesses, one file per family; each hands any value of its domain to a property function.
//!
//! Every assumption is followed by a cover, and every harness ends with one: what cannot be reached
//! proves nothing. `cargo test` compiles them too, and compares [`HARNESSES`] with `manifest.toml`.

/// Harness as its source declares it; `manifest.toml` holds the rest of the row.
#[cfg(not(kani))]
#[derive(Clone, Copy, Debug)]
pub struct Harness {
    /// Module of its family, from the crate's root.
    pub module: &'static str,
    /// Name of the function, unique over all families.
    pub name: &'static str,
    /// SAT solver.
    pub solver: &'static str,
    /// Bound of its loops; none where the solver needs none.
    pub unwind: Option<u32>,
    /// Functions replaced by an assumption about them: original, replacement.
    pub stubs: &'static [&'static str],
}

#[cfg(not(kani))]
impl Harness {
    /// Name of the family, which is the name of its file and of the crate's feature.
    #[must_use]
    pub fn family(&self) -> &'static str {
        self.module.rsplit(':').next().unwrap_or_default()
    }

    /// Full name, as Kani reports it.
    #[must_use]
    pub fn path(&self) -> String {
        let path = self.module.split_once("::").map_or("", |(_, path)| path);
        format!("{path}::{}", self.name)
    }
}

/// Declares the harnesses of a family, once per file:
/// `NAME [SOLVER, unwind BOUND, stub(ORIGINAL, REPLACEMENT)] { BODY }`, where bound and stubs are
/// optional. Each becomes a Kani proof that ends with a cover, and a row of [`HARNESSES`].
macro_rules! harnesses {
    ($(
        $(#[doc = $doc:literal])*
        $name:ident [$solver:tt $(, unwind $unwind:tt)? $(, stub($($stub:tt)*))*] { $($body:tt)* }
    )*) => {
        $(
            $(#[doc = $doc])*
            #[cfg_attr(kani, kani::proof, kani::solver($solver) $(, kani::unwind($unwind))? $(, kani::stub($($stub)*))*)]
            fn $name() {
                { $($body)* }
                kani::cover!(true, "the end is reached");
            }
            // Type-checked by every build; Kani alone can run it.
            #[cfg(not(kani))]
            const _: fn() = $name;
        )*
        #[cfg(not(kani))]
        pub(super) const HARNESSES: &[super::Harness] = &[$(super::Harness {
            module: module_path!(),
            name: stringify!($name),
            solver: stringify!($solver),
            unwind: [$($unwind)?].as_slice().first().copied(),
            stubs: &[$(stringify!($($stub)*)),*],
        }),*];
    };
}

/// Assumes a condition, and covers what the text says is still possible under it.
macro_rules! assume {
    ($condition:expr, $possible:expr, $text:literal) => {
        kani::assume($condition);
        kani::cover!($possible, $text);
    };
}

/// Stands in for Kani's library where another compiler checks the types of the harnesses. Nothing
/// calls it.
#[cfg(not(kani))]
#[allow(dead_code, reason = "named by functions that only Kani runs")]
mod kani {
    pub(super) fn any<T>() -> T {
        panic!("only Kani makes any value there is")
    }

    pub(super) const fn assume(_: bool) {}

    pub(super) const fn covers(_: bool, _: &str) {}

    macro_rules! cover {
        ($condition:expr, $text:literal) => {
            $crate::harness::kani::covers($condition, $text)
        };
    }
    pub(super) use cover;
}
#[cfg(kani)]
use ::kani;

// One feature per family: Kani translates and links every harness it finds, on every run. `only`
// leaves out the families not named. Measured for a harness of `fsm`: 3.4 s of CPU time alone, 53 s
// with all families.
#[cfg(any(not(feature = "only"), feature = "agitation"))]
mod agitation;
#[cfg(any(not(feature = "only"), feature = "axis"))]
mod axis;
#[cfg(any(not(feature = "only"), feature = "blackbox"))]
mod blackbox;
#[cfg(feature = "capi")]
mod capi;
#[cfg(any(not(feature = "only"), feature = "channel"))]
mod channel;
#[cfg(any(not(feature = "only"), feature = "client"))]
mod client;
#[cfg(any(not(feature = "only"), feature = "compensation"))]
mod compensation;
#[cfg(any(not(feature = "only"), feature = "crossing"))]
mod crossing;
#[cfg(any(not(feature = "only"), feature = "drive"))]
mod drive;
#[cfg(any(not(feature = "only"), feature = "endpoint"))]
mod endpoint;
#[cfg(any(not(feature = "only"), feature = "fsm"))]
mod fsm;
#[cfg(any(not(feature = "only"), feature = "ingress"))]
mod ingress;
#[cfg(feature = "keys")]
mod keys;
#[cfg(any(not(feature = "only"), feature = "kinematics"))]
mod kinematics;
#[cfg(feature = "labcomm")]
mod labcomm;
#[cfg(feature = "labcomm_decoder")]
mod labcomm_decoder;
#[cfg(any(not(feature = "only"), feature = "monitor"))]
mod monitor;
#[cfg(any(not(feature = "only"), feature = "motors"))]
mod motors;
#[cfg(any(not(feature = "only"), feature = "no_panic"))]
mod no_panic;
#[cfg(feature = "pacer")]
mod pacer;
#[cfg(feature = "position_loop")]
mod position_loop;
#[cfg(any(not(feature = "only"), feature = "session"))]
mod session;
#[cfg(any(not(feature = "only"), feature = "tick"))]
mod tick;
#[cfg(any(not(feature = "only"), feature = "wire"))]
mod wire;

/// Every harness, family by family.
#[cfg(not(any(kani, feature = "only")))]
pub const HARNESSES: &[&[Harness]] = &[
    agitation::HARNESSES,
    axis::HARNESSES,
    blackbox::HARNESSES,
    capi::HARNESSES,
    channel::HARNESSES,
    client::HARNESSES,
    compensation::HARNESSES,
    crossing::HARNESSES,
    drive::HARNESSES,
    endpoint::HARNESSES,
    fsm::HARNESSES,
    ingress::HARNESSES,
    keys::HARNESSES,
    kinematics::HARNESSES,
    labcomm::HARNESSES,
    labcomm_decoder::HARNESSES,
    monitor::HARNESSES,
    motors::HARNESSES,
    no_panic::HARNESSES,
    pacer::HARNESSES,
    position_loop::HARNESSES,
    session::HARNESSES,
    tick::HARNESSES,
    wire::HARNESSES,
];
