//! Forward dynamics and synthetic laboratories with known truth
