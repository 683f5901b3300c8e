//! One bounded reference value: gate and ramp.
