//! Any loop in any valid state, any configuration that validation accepts, any input.

use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::position_loop::{LoopInput, LoopParts, PositionLoop};
use gantry_tau_core::units::PositionNm;

use super::kani;
use crate::properties::position_loop::{self as loops, Before, MAX_WEIGHTED};

/// Any loop.
fn any_unchecked() -> LoopParts {
    // Written out: a loop over the history would set the bound of all others.
    LoopParts {
        history: [
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
            kani::any(),
        ],
        integral: kani::any(),
        velocity: kani::any(),
        torque: kani::any(),
        outside: kani::any(),
        limited: kani::any(),
        stop: kani::any(),
    }
}

/// Any loop that is valid under its configuration.
fn any_loop(config: &LoopConfig) -> PositionLoop {
    let axis = PositionLoop::from_parts(any_unchecked(), config);
    let runs = axis.is_some_and(|axis| axis.stop().is_none() && !axis.is_at_rest());
    assume!(axis.is_some(), runs, "some loops run and move");
    axis.unwrap_or(PositionLoop::at_rest(PositionNm(0)))
}

/// Checks a property of one tick of any loop.
fn check(property: impl Fn(&PositionLoop, &LoopConfig, &LoopInput)) {
    let config: LoopConfig = kani::any();
    property(&any_loop(&config), &config, &kani::any());
}

/// Any place below a number.
fn any_below(count: usize) -> usize {
    let place = kani::any();
    assume!(place < count, place > 0, "not only the first place");
    place
}

/// Any value that may be weighted.
fn any_value() -> i64 {
    let value = kani::any();
    assume!(
        (-MAX_WEIGHTED..=MAX_WEIGHTED).contains(&value),
        value < 0,
        "some values are below zero"
    );
    value
}

/// Any valid loops of three axes.
fn any_axes([one, two, three]: &[LoopConfig; 3]) -> [PositionLoop; 3] {
    [any_loop(one), any_loop(two), any_loop(three)]
}

/// Valid loops of three axes, anything that they get.
fn any_loops() -> Before<3> {
    let config: [LoopConfig; 3] = [kani::any(), kani::any(), kani::any()];
    let before = Before {
        config,
        axes: any_axes(&config),
        earlier: any_axes(&config),
        inputs: [kani::any(), kani::any(), kani::any()],
        accepted: kani::any(),
    };
    let loops = before.loops();
    assume!(
        loops.is_some(),
        loops.is_some_and(|loops| loops.is_running()),
        "some loops run"
    );
    before
}

/// Stand-in for the product.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
mod unknown {
    use core::sync::atomic::{AtomicI64, AtomicU16, AtomicUsize, Ordering};

    use super::kani;
    use crate::properties::position_loop::{MAX_WEIGHTED, is_product_of};

    /// Products that are remembered: those of one axis.
    const CALLS: usize = 4;
    static VALUES: [AtomicI64; CALLS] = [const { AtomicI64::new(0) }; CALLS];
    static WEIGHTS: [AtomicU16; CALLS] = [const { AtomicU16::new(0) }; CALLS];
    static PRODUCTS: [AtomicI64; CALLS] = [const { AtomicI64::new(0) }; CALLS];
    static COUNT: AtomicUsize = AtomicUsize::new(0);

    /// Any number with the sign and the bound of a product.
    pub(super) fn any(value: i64, weight: u16) -> i64 {
        let within = (-MAX_WEIGHTED..=MAX_WEIGHTED).contains(&value);
        assert!(within, "T20: nothing beyond 2^25 is weighted");
        let product = kani::any();
        assume!(
            is_product_of(value, weight, product),
            product != 0,
            "some products are not zero"
        );
        product
    }

    /// As [`any`], and the same again for the first values and weights.
    pub(super) fn product(value: i64, weight: u16) -> i64 {
        let mut product = any(value, weight);
        let count = COUNT.load(Ordering::Relaxed);
        for call in 0..CALLS {
            let is_known = call < count
                && VALUES[call].load(Ordering::Relaxed) == value
                && WEIGHTS[call].load(Ordering::Relaxed) == weight;
            if is_known {
                product = PRODUCTS[call].load(Ordering::Relaxed);
            }
        }
        if count < CALLS {
            VALUES[count].store(value, Ordering::Relaxed);
            WEIGHTS[count].store(weight, Ordering::Relaxed);
            PRODUCTS[count].store(product, Ordering::Relaxed);
            COUNT.store(count + 1, Ordering::Relaxed);
        }
        product
    }

    /// As [`product`], and of two values the larger has no smaller product with the same weight.
    pub(super) fn monotone(value: i64, weight: u16) -> i64 {
        let product = product(value, weight);
        for call in 0..CALLS {
            let (other, of_other) = (
                VALUES[call].load(Ordering::Relaxed),
                PRODUCTS[call].load(Ordering::Relaxed),
            );
            let comparable = call < COUNT.load(Ordering::Relaxed)
                && WEIGHTS[call].load(Ordering::Relaxed) == weight;
            let is_monotone = if other <= value {
                of_other <= product
            } else {
                of_other >= product
            };
            assume!(
                !comparable || is_monotone,
                comparable && of_other != product,
                "some products differ"
            );
        }
        product
    }
}

/// Stand-in for the second half of a tick.
#[allow(dead_code, reason = "named by functions that only Kani runs")]
mod given {
    use std::sync::Mutex;

    use gantry_tau_core::control::position_loop::config::LoopConfig;
    use gantry_tau_core::control::position_loop::{LoopInput, PositionLoop, VelocityReference};
    use gantry_tau_core::units::{PositionNm, TorquePermille, VelocityUmS};

    type Given = (PositionLoop, LoopConfig, LoopInput, i64);
    static FIRST: Mutex<Option<Given>> = Mutex::new(None);

    /// Says whether it is given the same as in the first call: as the state, and as the output.
    pub(super) fn act(
        axis: &mut PositionLoop,
        config: &LoopConfig,
        input: &LoopInput,
        error: i64,
    ) -> VelocityReference {
        let given = (*axis, *config, *input, error);
        let Ok(mut first) = FIRST.lock() else {
            panic!("one thread")
        };
        let is_same = *first.get_or_insert(given) == given;
        *axis = PositionLoop::at_rest(PositionNm(is_same.into()));
        VelocityReference {
            velocity: VelocityUmS(is_same.into()),
            torque: TorquePermille(0),
        }
    }
}

harnesses! {
    position_loop_references_are_bounded [minisat, unwind 6] { check(loops::references_are_bounded); }
    position_loop_stops_with_its_ramp [minisat, unwind 6] {
        check(|axis, config, input| loops::stops_with_its_ramp(axis, config, input, kani::any()));
    }
    position_loop_trips_in_its_tick [minisat, unwind 6] {
        check(|axis, config, input| loops::trips_in_its_tick(axis, config, input, any_below(11)));
    }
    position_loop_is_released_by_a_rearm [minisat, unwind 6] { check(loops::is_released_by_a_rearm); }
    position_loop_error_is_exact [minisat] { loops::error_is_exact(kani::any(), kani::any()); }
    position_loop_product_is_bounded [cadical] { loops::product_is_bounded(any_value(), kani::any()); }
    position_loop_term_is_exact [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::product)] {
        loops::term_is_exact(any_value(), kani::any());
        loops::feed_forward_is_exact(any_value(), kani::any());
    }
    position_loop_term_is_monotone [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::monotone)] {
        let (value, larger, weight) = (any_value(), any_value(), kani::any());
        loops::term_is_monotone(value, larger, weight);
        loops::feed_forward_is_monotone(value, larger, weight);
    }
    position_loop_integral_is_bounded [minisat] {
        let (integral, most): (i64, i32) = (kani::any(), kani::any());
        let within = most >= 0 && integral.unsigned_abs() <= u64::from(most.unsigned_abs()) << 10;
        assume!(within, integral < 0, "some integrals are below zero");
        loops::integral_is_bounded(integral, kani::any(), kani::any(), most);
    }
    position_loop_follows_its_terms [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::product)] { check(loops::follows_its_terms); }
    position_loops_run_together [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::any)] { loops::axes_run_together::<3>(&any_loops()); }
    position_loops_are_bounded [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::any)] {
        loops::axis_of_many_is_bounded::<3>(&any_loops(), any_below(3));
    }
    position_loops_act_alone [minisat, unwind 12, stub(gantry_tau_core::control::position_loop::PositionLoop::act, crate::harness::position_loop::given::act)] {
        loops::axis_of_many_acts_alone::<3>(&any_loops(), any_below(3));
    }
    position_loops_are_refused [minisat, unwind 6, stub(gantry_tau_core::verification::position_loop::product, crate::harness::position_loop::unknown::any)] {
        loops::refused_references_are_not_in_force::<3>(&any_loops(), any_below(3), &kani::any());
    }
}
