//! From a wrench at the tool to bounded cart offsets.
