//! Robot files: `robots/*.toml`.
