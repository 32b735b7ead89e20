//! Empty library. The package exists for `tests/tests/architecture.rs`, which checks the
//! dependencies between the crates. The stories (`tests/stories`) and the checks of the book
//! (`tests/docs`) are test targets of `aloft-cli`, because they run its binary.
